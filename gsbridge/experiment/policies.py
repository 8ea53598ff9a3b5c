"""A trained policy: what it learns, on what, how, and where its files and those of its trials lie."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from gsbridge.configuration.renderers import trained_on


@dataclass(frozen=True)
class PolicyFiles:
    """Names and paths of a policy, whatever the seed of its training.

    Args:
        task: What the policy does.
        object: Scene of the object that it handles.
        background: Scene of the table under the object.
        renderer: What drew its pictures while it learned.
        variant: Way of learning.
    """

    task: str
    object: str
    background: str
    renderer: str = "gs"
    variant: str = "default"

    @classmethod
    def of(cls, cell: Mapping[str, Any], variant: str = "default") -> PolicyFiles:
        """The policy of a cell of the configuration, which may name a renderer."""
        return cls(cell["task"], cell["object"], cell["background"], cell.get("renderer", "gs"), variant)

    @property
    def pair(self) -> str:
        """Object and background, as paths name them."""
        return f"{self.object}+{self.background}"

    @property
    def scenes(self) -> set[str]:
        """Names of both scenes."""
        return {self.object, self.background}

    @property
    def place(self) -> str:
        """Folder below `policies/` or `trials/`."""
        return f"{self.task}/{self.pair}/{self.renderer}/{self.variant}"

    @property
    def item(self) -> str:
        """Name without slashes or blanks, for the names of logs and recordings."""
        return f"{self.task}-{self.pair}-{self.renderer}-{self.variant}"

    @property
    def title(self) -> str:
        """Name on pages."""
        named = f"{self.task.replace('_', ' ').capitalize()}: {self.object} on {self.background}"
        return named.replace("_", " ") + trained_on(self.renderer)

    def file(self, seed: int | str, name: str) -> str:
        """A file that the training with one seed makes."""
        return f"results/policies/{self.place}/seed{seed}/{name}"

    def trials(self, world: str, seed: int | str, ending: str) -> str:
        """Path of the table, log or record of the trials in one world.

        Args:
            world: Name of the world that the policy was tried in.
            seed: Seed of the policy's training.
            ending: Ending of the file's name, such as `csv` or `npz`.
        """
        return f"results/trials/{self.place}/{world}/seed{seed}.{ending}"


def workspace_of(variant: Mapping[str, Any]) -> dict[str, str]:
    """Files about the work place that a variant is trained and tried with, by the names of the rules' inputs.

    Args:
        variant: An entry of `variants`. If it names a world in which the work place was registered anew, camera and colours
            come from that world, too; colours come from `calibrated_in` if that is set.
    """
    again = variant["registered_in"], variant["calibrated_in"] or variant["registered_in"]
    placed, coloured = (f"results/workspace/worlds/{world}" if world else "" for world in again)
    return {
        "registration": f"{placed or 'results/workspace'}/registration.json",
        "robot": f"{placed}/description" if placed else "results/robot/description",
        "photometry": f"{coloured or 'results/workspace'}/photometry.json",
        "robot_splats": f"{coloured}/splats" if coloured else "results/robot/splats",
    }


def training_memory(settings: Mapping[str, Any]) -> int:
    """Memory of a training, MB: libraries and pictures in use, the replay buffer, and each further environment."""
    replay = 3e-6 * settings["replay_capacity"] * settings["image_size"] ** 2
    return round(2350 + replay + 400 * (settings["environments"] - 1))


def training_minutes(settings: Mapping[str, Any]) -> int:
    """Time limit of a training, minutes, long enough for slow machines."""
    return max(60, round(settings["steps"] / 100))


ANY = PolicyFiles("{task}", "{object}", "{background}", "{renderer}", "{variant}")
"""Any policy: its paths are patterns, whose wildcards are named in braces."""


def policy_files(policies: Iterable[PolicyFiles], seeds: Iterable[int], name: str) -> list[str]:
    """Path of one file of each policy and seed.

    Args:
        policies: The policies.
        seeds: Seeds of their trainings.
        name: Name of the file in the training's folder.
    """
    seeds = list(seeds)
    return [policy.file(seed, name) for policy in policies for seed in seeds]
