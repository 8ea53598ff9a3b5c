"""The severity study: which trials of the controller and of policies run in worlds of which severity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gsbridge.experiment.plan import Experiment
from gsbridge.experiment.policies import PolicyFiles, policy_files
from gsbridge.experiment.tables import Tables

CONTROLLER, CELLS, WORTH, GRADED = "controller", "severity", "worth", "graded"
SIM = "sim"

JUDGED = (2, 3)
"""Severities at which the policies of the tables are judged: 2 is an ordinary lab, 3 is worse."""


@dataclass(frozen=True)
class SeverityStudy:
    """Trials by severity: of the baseline controller, of the policies of the tables (`severity`), of policies that learned from
    splats and from meshes (`worth`), and of policies from poor to good (`graded`).

    Args:
        plan: Scenes, cells and settings.
    """

    plan: Experiment

    @property
    def _settings(self) -> Mapping[str, Any]:
        return self.plan.config["study"]["severity"]

    @property
    def worlds(self) -> list[dict[str, Any]]:
        """Name, seed and severities of each world."""
        return [self._world(name) for name in self._settings["worlds"]]

    @property
    def levels(self) -> dict[str, tuple[int, int]]:
        """Severity of look and of physics by the name of the world."""
        return {world["world"]: (world["look"], world["physics"]) for world in self.worlds}

    @property
    def judged(self) -> list[str]:
        """Worlds in which the policies of the tables are tried: those of a severity in `JUDGED`, look and physics alike."""
        return [name for name, severity in self.levels.items() if severity in {(level, level) for level in JUDGED}]

    @property
    def controller(self) -> list[dict[str, Any]]:
        """One entry per record of the controller's trials, in the first cell: `file`, who acted, and in which world."""
        first = self._settings["cells"][0]
        cell = {key: first[key] for key in ("task", "object", "background")}
        pair = PolicyFiles.of(cell).pair
        return [
            {"file": f"results/trials/{cell['task']}/{pair}/{world['world']}.json", "who": CONTROLLER, **cell, **world}
            for world in self.worlds
        ]

    def policies(self, who: str) -> list[PolicyFiles]:
        """Policies of the tables (`severity`), those of `worth`, cell by cell, or the `graded` ones of the first cell."""
        if who == CELLS:
            return Tables(self.plan).policies
        study = self._settings
        if who == GRADED:
            return [PolicyFiles.of(study["cells"][0], variant) for variant in study["graded"]]
        return [
            PolicyFiles.of({**cell, "renderer": renderer}, variant)
            for cell in study["cells"]
            for variant in study["variants"]
            for renderer in study["renderers"]
        ]

    def seeds(self, who: str) -> list[int]:
        """Seeds of the trainings of each policy; only one for graded policies, which differ enough by themselves."""
        if who == CELLS:
            return Tables(self.plan).seeds
        first: int = self.plan.config["seed"]
        return list(range(first, first + (1 if who == GRADED else self._settings["seeds"])))

    def worlds_of(self, who: str) -> list[str]:
        """Names of the worlds that policies are tried in; simulation is among them, except for `worth`."""
        if who == CELLS:
            return [SIM, *self.judged]
        return [SIM] * (who == GRADED) + list(self._settings["worlds"])

    def compares(self, who: str) -> bool:
        """Whether there is a policy to try, and a world of some severity to try it in."""
        return bool(self.policies(who)) and self.worlds_of(who) not in ([], [SIM])

    def trials(self, who: str, ending: str) -> list[str]:
        """Paths of the files about trials; trials in simulation are among them, except for `worth`.

        Args:
            who: `severity`, `worth` or `graded`.
            ending: Ending of the files' names, such as `csv`.
        """
        worlds, policies = self.worlds_of(who), self.policies(who)
        if who == CELLS:
            return Tables(self.plan).trials(policies, worlds, ending)
        return [policy.trials(world, seed, ending) for policy in policies for seed in self.seeds(who) for world in worlds]

    def trainings(self, who: str) -> list[str]:
        """Records of the trainings."""
        return policy_files(self.policies(who), self.seeds(who), "training.json")

    def scenes(self, who: str) -> list[str]:
        """Records of the stages that made the scenes."""
        return Tables(self.plan).scene_records(self.policies(who))

    def _world(self, name: str) -> dict[str, Any]:
        """Name, seed and severity of a world."""
        seed, (look, physics) = self.plan.config["worlds"][name]["seed"], self.plan.severity(name)
        return {"world": name, "seed": self.plan.config["seed"] if seed is None else seed, "look": look, "physics": physics}
