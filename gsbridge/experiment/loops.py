"""Loops that an experiment closes: a world changes, the gap is named, the simulation amended, and the policy learns anew."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gsbridge.experiment.plan import Experiment
from gsbridge.experiment.policies import PolicyFiles

ROLES = ("fit", "select", "verify")
"""Roles of a case's records: to fit, to choose among fits, and to verify the choice."""


@dataclass(frozen=True)
class Loop(ABC):
    """What is tried and trained to close a loop on one cell.

    Args:
        plan: Scenes, cells and settings.
    """

    plan: Experiment

    @property
    @abstractmethod
    def settings(self) -> Mapping[str, Any]:
        """Section of the configuration about the loop."""

    @property
    @abstractmethod
    def cell(self) -> dict[str, Any]:
        """Values of the wildcards in the paths of the loop's rules."""

    @property
    @abstractmethod
    def rows(self) -> list[dict[str, str]]:
        """Variant and world of each row of the loop's table."""

    @property
    def seeds(self) -> range:
        """Seeds of the trainings of each variant; the first is the configuration's."""
        first = int(self.cell["seed"])
        return range(first, first + int(self.settings["trainings"]))

    def policy(self, variant: str) -> PolicyFiles:
        """The cell's policy of one variant."""
        return PolicyFiles.of(self.cell, variant)

    @property
    def tables(self) -> list[str]:
        """Files of the trials behind the table: row by row, and seed by seed within a row."""
        return [self.policy(row["variant"]).trials(row["world"], seed, "csv") for row in self.rows for seed in self.seeds]

    @property
    def trainings(self) -> list[str]:
        """Records of the trainings of all policies in the table: policy by policy, and seed by seed within a policy."""
        variants = dict.fromkeys(row["variant"] for row in self.rows)
        return [self.policy(variant).file(seed, "training.json") for variant in variants for seed in self.seeds]


class JointLoop(Loop):
    """The loop that is closed with logs of the arm, on one cell."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """Section `loop` of the configuration: worlds, cell and variant."""
        loop: Mapping[str, Any] = self.plan.config["loop"]
        return loop

    @property
    def cell(self) -> dict[str, Any]:
        """Values of the wildcards in the paths of the loop's rules."""
        return {**self.settings["cell"], "renderer": "gs", "seed": self.plan.config["seed"]}

    @property
    def cases(self) -> dict[str, dict[str, str]]:
        """Cases of the gap that the workflow makes by itself, beside those of the configuration."""
        return {
            "loop_reference": {"world": self.settings["reference"], "model": "nominal"},
            "loop_changed": {"world": self.settings["changed"], "model": "calibrated"},
        }

    @property
    def rows(self) -> list[dict[str, str]]:
        """Variant and world of each row of the table: the policies before and after, and the controls."""
        before, after, changed = "default", self.settings["variant"], self.settings["changed"]
        tried = [(before, "sim"), (before, self.settings["reference"]), (before, changed), (after, "sim"), (after, changed)]
        tried += [(control, changed) for control in self.settings["controls"]]
        return [{"variant": variant, "world": world} for variant, world in tried]

    @property
    def comparisons(self) -> list[dict[str, Any]]:
        """Comparisons that show what the diagnosis is worth: changed world, variant that learned anew for it, and controls."""
        settings = self.settings
        return [{"world": settings["changed"], "variant": settings["variant"], "controls": list(settings["controls"])}]

    @property
    def is_closed(self) -> bool:
        """Whether a variant is set that learns with what the diagnosis found."""
        return bool(self.settings["variant"] != "default")

    def trials(self, world: str, ending: str, variant: str = "default") -> str:
        """Path of a file about the trials in one world.

        Args:
            world: Name of the world that the policy was tried in.
            ending: Ending of the file's name, such as `csv` or `npz`.
            variant: Way of learning of the policy.
        """
        return self.policy(variant).trials(world, self.cell["seed"], ending)

    def records(self, world: str) -> dict[str, str]:
        """Logs of the arm from trials in one world, by role."""
        return {role: f"results/loop/records/{world}/{role}.csv" for role in ROLES}

    def model(self, case: str) -> str:
        """The arm's model in a case."""
        return f"results/loop/arm/{self.cases[case]['model']}.yaml"

    def case(self, case: str) -> dict[str, Any]:
        """Files that a case is made from: the arm's model, its calibration if there is one, and the logs by role."""
        calibration = "results/loop/arm/calibration.json" if self.cases[case]["model"] == "calibrated" else []
        return {"model": self.model(case), **self.records(self.cases[case]["world"]), "calibration": calibration}

    def case_files(self, case: str) -> list[str]:
        """Files that a case names."""
        return [self.model(case), "results/loop/arm/arm.urdf", *self.records(self.cases[case]["world"]).values()]


class PictureLoop(Loop):
    """The loop that is closed with photos of the wrist camera, on one cell."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """Worlds, variants, postures and repeats."""
        section: Mapping[str, Any] = self.plan.config["study"]["picture_gap"]
        return section

    @property
    def cell(self) -> dict[str, Any]:
        """Values of the wildcards in the paths of the loop's rules."""
        return {**self.plan.config["study"]["cell"], "renderer": "gs", "seed": self.plan.config["seed"]}

    @property
    def repeats(self) -> int:
        """Number of photos of a posture in the reference world.

        They are the one that is compared, as many repeats as are configured, and one that stands for a later day.
        """
        return int(self.settings["repeats"]) + 2

    def shots(self, world: str) -> int:
        """Number of photos of each posture in a world."""
        return self.repeats if world == self.settings["reference"] else 1

    def first_shot(self, world: str) -> int:
        """Index of a world's first photo; the photos of the reference world come before all others."""
        return 0 if world == self.settings["reference"] else self.repeats * int(self.settings["postures"])

    @property
    def worlds(self) -> list[str]:
        """Worlds that are photographed. The reference itself is diagnosed too: nothing may be found in it."""
        return [self.settings["reference"], *self.settings["amended"]] if self.settings["amended"] else []

    @property
    def rows(self) -> list[dict[str, str]]:
        """Variant and world of each row of the table: the policies before, those that learned anew, and the controls."""
        before = [(variant, world) for variant in self.settings["variants"] for world in ("sim", *self.worlds)]
        amended = self.settings["amended"].items()
        after = [(variant, place) for world, variants in amended for variant in variants for place in ("sim", world)]
        beside = [(variant, world) for world, variants in self.settings["controls"].items() for variant in variants]
        return [{"variant": variant, "world": world} for variant, world in dict.fromkeys(before + after + beside)]

    @property
    def comparisons(self) -> list[dict[str, Any]]:
        """Comparisons that show what the diagnosis is worth: each world, the variant that learned anew for it, and controls."""
        settings = self.settings
        return [
            {"world": world, "variant": variants[0], "controls": list(settings["controls"].get(world, []))}
            for world, variants in settings["amended"].items()
            if variants
        ]

    def same_but_model(self, variant: str) -> str:
        """The table's earlier variant that differs in its model alone from `variant`, which learned anew; "" if none does."""
        variants = self.plan.config["variants"]
        rest = {name: {key: value for key, value in plan.items() if key != "model"} for name, plan in variants.items()}
        return next((name for name in self.settings["variants"] if rest[name] == rest[variant]), "")


def closed_loops(joints: JointLoop, pictures: PictureLoop) -> list[dict[str, str]]:
    """One entry per changed world: its table, the reference world, and the variants of the policies before and after."""
    loops = []
    if joints.is_closed:
        worlds = {"reference": joints.settings["reference"], "world": joints.settings["changed"]}
        loops.append({"table": "loop", **worlds, "before": "default", "after": joints.settings["variant"]})
    for world, variants in pictures.settings["amended"].items():
        after = variants[0] if variants else ""
        before = pictures.same_but_model(after) if after else "default"
        worlds = {"reference": pictures.settings["reference"], "world": world}
        loops.append({"table": "picture_loop", **worlds, "before": before, "after": after})
    return loops
