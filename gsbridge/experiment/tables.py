"""Which policies an experiment trains, which of their trials there are, and which tables show them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from gsbridge.experiment.plan import Experiment
from gsbridge.experiment.policies import PolicyFiles, policy_files


@dataclass(frozen=True)
class TrialFiles:
    """The trials of one policy in one world.

    Args:
        policy: The policy that is tried.
        world: World that it is tried in: `sim`, or a world of the mirror.
        seed: Seed of its training.
    """

    policy: PolicyFiles
    world: str
    seed: int

    def file(self, ending: str) -> str:
        """Path of the trials' table, log or record."""
        return self.policy.trials(self.world, self.seed, ending)


@dataclass(frozen=True)
class Tables:
    """Policies and trials of an experiment, by the table that shows them.

    Args:
        plan: Scenes, cells and settings.
    """

    plan: Experiment

    @cached_property
    def policies(self) -> list[PolicyFiles]:
        """Policies that the preset trains: one for each cell whose scenes run here."""
        every = (PolicyFiles.of(cell) for cell in self.plan.cells)
        return [policy for policy in every if policy.scenes <= set(self.plan.scenes)]

    @cached_property
    def seeds(self) -> list[int]:
        """Seeds of the trainings of each policy."""
        first: int = self.plan.config["seed"]
        return list(range(first, first + self.plan.settings("trials")["policies"]))

    @property
    def worlds(self) -> list[str]:
        """Simulation, and the worlds of the mirror in which every policy is tried."""
        return ["sim", *self.plan.settings("trials")["worlds"]]

    # Pictures of trials

    def pictured_worlds(self, policy: PolicyFiles) -> list[str]:
        """Worlds that pictures show side by side: simulation, and the first mirror where it films both scenes."""
        return self.worlds[: 2 if policy.scenes <= set(self.plan.in_mirror) else 1]

    def pictured(self, policy: PolicyFiles) -> list[TrialFiles]:
        """Trials that pictures of a policy show, in the order of their files."""
        return [TrialFiles(policy, world, seed) for seed in self.seeds for world in self.pictured_worlds(policy)]

    @property
    def compared(self) -> list[TrialFiles]:
        """Trials in which behaviour is compared: those of policies with a second world."""
        both = (policy for policy in self.policies if len(self.pictured_worlds(policy)) > 1)
        return [trial for policy in both for trial in self.pictured(policy)]

    @property
    def films(self) -> dict[str, str]:
        """Films of trials on the page of tables: file by title."""
        return {policy.title: f"results/films_of_trials/{policy.item}.webp" for policy in self.policies}

    @property
    def pictures(self) -> list[str]:
        """All pictures of trials: films, recordings, and the figure where there is a second world."""
        beside = [f"results/onlooker_films/{policy.item}.webp" for policy in self.policies]
        recorded = [f"results/rerun/trials/{policy.item}.rrd" for policy in self.policies]
        films = [*self.films.values(), *beside]
        return [*films, *recorded, *(["results/figures/behaviour_consistency.png"] if self.compared else [])]

    @property
    def recordings(self) -> list[str]:
        """Rerun recordings of trials and trainings."""
        out = []
        for policy in self.policies:
            out.append(f"results/rerun/trials/{policy.item}.rrd")
            out += [f"results/rerun/training/{policy.item}-seed{seed}.rrd" for seed in self.seeds]
        return out

    # Tables of successes

    def shown(self, table: str) -> list[PolicyFiles]:
        """Policies that a table shows: of `gs` only, except for `renderer_contrast`, which shows all renderers of a cell."""
        if table == "worlds":
            return [policy for policy in self.policies if policy.renderer == "gs"]
        if table == "picture_gap":
            study = self.plan.config["study"]
            return [PolicyFiles.of(study["cell"], variant) for variant in study["picture_gap"]["variants"]]
        task = "pick_and_place" if table == "pick_and_place" else "grasp"
        chosen = [policy for policy in self.policies if policy.task == task]
        if table != "renderer_contrast":
            return [policy for policy in chosen if policy.renderer == "gs"]
        pairs = {policy.pair for policy in chosen if policy.renderer != "gs"}
        return [policy for policy in chosen if policy.pair in pairs]

    def shown_worlds(self, table: str) -> list[str]:
        """Worlds that a table shows."""
        study = self.plan.config["study"]
        further = {"worlds": study["worlds"], "picture_gap": study["picture_gap"]["worlds"]}
        return ["sim", *further[table]] if table in further else self.worlds

    @property
    def successes(self) -> list[str]:
        """Names of the tables that the preset's policies fill."""
        return [table for table in ("grasping", "renderer_contrast", "pick_and_place") if self.shown(table)]

    @property
    def world_variants(self) -> list[str]:
        """Names of the tables about further worlds, where any are named."""
        named = [table for table in ("worlds", "picture_gap") if len(self.shown_worlds(table)) > 1]
        return [table for table in named if self.shown(table)]

    @property
    def rows(self) -> list[str]:
        """Names of all rows about policies, where the preset trains any."""
        return [*self.successes, "failures", "training"] if self.policies else []

    @property
    def figures(self) -> list[str]:
        """Names of the figures about policies, where the preset trains any."""
        names = ["success_rates", "learning_curves"] if self.policies else []
        return names + (["behaviour_consistency"] if self.compared else [])

    def trials(self, policies: Sequence[PolicyFiles], worlds: Sequence[str], ending: str) -> list[str]:
        """Paths of files about trials.

        Args:
            policies: The policies that are tried.
            worlds: Worlds that they are tried in; worlds of the mirror have the mirror's own scenes only.
            ending: Ending of the file's name, such as `csv` or `npz`.

        Returns:
            Paths, by policy, world and seed.
        """
        filmed = set(self.plan.in_mirror)
        return [
            policy.trials(world, seed, ending)
            for policy in policies
            for world in worlds
            if world == "sim" or policy.scenes <= filmed
            for seed in self.seeds
        ]

    def table_trials(self, table: str, ending: str) -> list[str]:
        """Files about the trials that a table is made of."""
        return self.trials(self.shown(table), self.shown_worlds(table), ending)

    def table_trainings(self, table: str) -> list[str]:
        """Records of the trainings of a table's policies."""
        return policy_files(self.shown(table), self.seeds, "training.json")

    def table_scenes(self, table: str) -> list[str]:
        """Records of the stages that made the scenes of a table."""
        return self.scene_records(self.shown(table))

    def scene_records(self, policies: Sequence[PolicyFiles]) -> list[str]:
        """Records of the stages that made the scenes of policies."""
        scenes = sorted(set().union(*(policy.scenes for policy in policies)))
        stages = ("capture/keyframes", "sfm/sfm", "align/align", "mesh/mesh", "asset/asset")
        masked = [scene for scene in scenes if scene in self.plan.named("object")]
        names = [f"{scene}/{stage}" for scene in scenes for stage in stages] + [f"{scene}/masks/masks" for scene in masked]
        return [f"results/scenes/{name}.json" for name in names]

    def robot_trials(self, policies: Sequence[PolicyFiles]) -> dict[str, str]:
        """A user's own trials of policies on a robot: CSV file by the policy's `place`."""
        measured = {PolicyFiles.of(cell).place: cell["robot_trials"] for cell in self.plan.cells if cell["robot_trials"]}
        places = [policy.place for policy in policies if policy.place in measured]
        return {place: self.plan.capture_path(measured[place]) for place in places}

    def table_robot_trials(self, table: str) -> dict[str, str]:
        """Trials on robots that a table shows; only the tables of `successes` show any."""
        return self.robot_trials(self.shown(table)) if table in self.successes else {}

    # The study of ways of learning

    def study_files(self, ending: str, *, trials: bool) -> list[str]:
        """Files of every variant and seed of the study: of trainings, or of trials in simulation."""
        study: Mapping[str, Any] = self.plan.config["study"]
        policies = [PolicyFiles.of(study["cell"], variant) for variant in study["variants"]]
        first = self.plan.config["seed"]
        seeds = range(first, first + study["seeds"])
        if not trials:
            return policy_files(policies, seeds, ending)
        return [policy.trials("sim", seed, ending) for policy in policies for seed in seeds]
