"""Trials of a trained policy in the simulated world, as in its training, and in the mirror, as on an arm.

See `gsbridge.environment.policy_trials` and `gsbridge.policy.arm_trials`.
"""

from __future__ import annotations

from pathlib import Path

import torch

from gsbridge.environment.build import StageFiles, build_environment
from gsbridge.environment.policy_trials import TrialPlace, pose_counts, run_trials, try_policy
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.environment.trials import TrialResult
from gsbridge.files import read_json
from gsbridge.policy.arm_trials import ArmTrials
from gsbridge.policy.export import Policy, load_policy
from gsbridge.policy.interface import PolicyInterface
from gsbridge.reality.mirror.path_tracer import variant
from gsbridge.reality.world.camera import Setting
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.mirror import mirror_world
from gsbridge.registration.result import read_registration


def try_in_sim(
    policy: str | Path,
    training: str | Path,
    files: StageFiles,
    settings: EnvironmentSettings,
    place: TrialPlace,
    *,
    poses: int,
    outside: int = 0,
) -> list[tuple[str, TrialResult]]:
    """Let a policy act in the world that it was trained in.

    Args:
        policy: Folder of the policy.
        training: Record of its training.
        files: What the environment is made of.
        settings: Settings of the environment.
        place: Files that the outcome is written to.
        poses, outside: Number of start poses of each set inside the start square of the training, and beyond it.

    Raises:
        InputError: A file is missing or damaged.
    """
    loaded = _load(policy)
    environment = build_environment(files, settings)
    try:
        return try_policy(environment, loaded, place, name="sim", poses=poses, outside=outside, reasons=_reasons(training))
    finally:
        environment.close()


def try_in_mirror(
    policy: str | Path,
    training: str | Path,
    setting: Setting,
    hidden: Hidden,
    registration: str | Path,
    place: TrialPlace,
    *,
    name: str,
    poses: int,
    outside: int = 0,
    pieces: str | Path,
) -> list[tuple[str, TrialResult]]:
    """Let a policy act in a world of the mirror as on an arm; the settings of an episode are those of the training.

    Args:
        policy: Folder of the policy.
        training: Record of its training.
        setting: Object and background of the mirror's scene.
        hidden: Hidden parameters of the world.
        registration: `registration.json`.
        place: Files that the outcome is written to.
        name: The world's name.
        poses, outside: Number of start poses of each set inside the start square of the training, and beyond it.
        pieces: Folder that keeps convex pieces from run to run.

    Raises:
        InputError: A file is missing or damaged, or registration and policy do not belong together.
    """
    loaded = _load(policy)
    play = ArmTrials(
        mirror_world(setting, hidden, pieces=pieces),
        read_registration(registration),
        PolicyInterface.of(loaded.spec),
        loaded,
    )
    settings = play.setup.interface.settings
    counts = pose_counts(settings.region(), poses, outside)
    doubts = [f"registration: {reason}" for reason in read_json(registration).get("reasons", [])]
    reasons = [*_reasons(training), *doubts]

    def facts() -> dict[str, object]:
        return {"path_tracer": variant()}

    return run_trials(play, settings.task, place, name=name, counts=counts, reasons=reasons, facts=facts)


def _load(folder: str | Path) -> Policy:
    torch.set_num_threads(1)
    return load_policy(folder)


def _reasons(training: str | Path) -> list[str]:
    """Return the reasons why the policy itself is degraded."""
    return [f"policy: {reason}" for reason in read_json(training).get("reasons", [])]
