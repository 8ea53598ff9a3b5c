"""Who is tried at which severity: the controller and policies of one cell, in worlds that differ in how bad a day it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gsbridge.experiment.plan import Experiment
from gsbridge.experiment.policies import PolicyFiles

CONTROLLER, POLICIES = "controller", "policies"


@dataclass(frozen=True)
class SeverityStudy:
    """Trials by severity.

    Args:
        plan: Scenes, cells and settings.
        seeds: Seeds of the trainings of each policy.
    """

    plan: Experiment
    seeds: list[int]

    def sources(self, who: str) -> list[dict[str, Any]]:
        """One entry per file of trials: `file`, who acted, and in which world.

        Args:
            who: `controller` or `policies`.
        """
        study: Mapping[str, Any] = self.plan.config["study"]["severity"]
        cell = {key: study["cell"][key] for key in ("task", "object", "background")}
        worlds = [self._world(name) for name in study["worlds"]]
        if who == CONTROLLER:
            pair = f"{cell['object']}+{cell['background']}"
            return [
                {"file": f"results/trials/{cell['task']}/{pair}/{world['world']}.json", "who": who, **cell, **world}
                for world in worlds
            ]
        return [
            {
                "file": PolicyFiles.of({**cell, "renderer": renderer}, variant).trials(world["world"], seed, "csv"),
                "who": "policy",
                "renderer": renderer,
                "variant": variant,
                "training": seed,
                **cell,
                **world,
            }
            for renderer in study["renderers"]
            for variant in study["variants"]
            for seed in self.seeds
            for world in worlds
        ]

    def files(self, who: str) -> list[str]:
        """Files of trials that `sources` lists."""
        return [source["file"] for source in self.sources(who)]

    def _world(self, name: str) -> dict[str, Any]:
        """Name, seed and severity of a world."""
        world = self.plan.config["worlds"][name]
        given = world["severity"]
        graded = given if isinstance(given, dict) else {"look": given, "physics": given}
        return {"world": name, "seed": self.plan.config["seed"] if world["seed"] is None else world["seed"], **graded}
