"""The stage that trains one policy: it reads files, and writes the policy, its curve and a record."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import fields
from pathlib import Path

from gsbridge.configuration.policy import PolicySettings
from gsbridge.environment.biased import BiasedController
from gsbridge.environment.build import StageFiles, build_controller, build_environment, environment_makers
from gsbridge.environment.env import PickEnvironment
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_stage
from gsbridge.policy.curve import PARTS, Row
from gsbridge.policy.observation import Controller
from gsbridge.policy.onnx import export_onnx
from gsbridge.policy.trainer import Trainer, Training
from gsbridge.sim.world import SimWorld

ENOUGH = 0.95
"""Success rate at which a policy counts as trained, for the figure of CPU seconds until then."""

POOR = 0.9
"""Success rate in the world of the training below which a policy is degraded."""

RINGING = 0.05
"""Critics count as diverging if more than this share of updates had targets beyond the largest return; early on, some have."""


def train_policy(
    files: StageFiles,
    environment_settings: EnvironmentSettings,
    settings: PolicySettings,
    out: str | Path,
    record: str | Path,
    *,
    seed: int,
    state: str | Path,
    controller_offset: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    unchanged_teacher: bool = False,
) -> Training:
    """Train a policy in the simulated world and write it.

    Args:
        files: What the environment is made of.
        environment_settings: Settings of the environment.
        settings: Settings of the training.
        out: Folder of the policy and its curve.
        record: Record of the stage.
        seed: Seed of everything random.
        state: Folder of checkpoints; it is removed at the end.
        controller_offset: Offset of the baseline controller, see `BiasedController`, m and rad. [4].
        unchanged_teacher: Whether the controller ignores the model's delay.

    Raises:
        InputError: A file is missing, damaged or of the wrong kind; settings do not fit together.
    """
    environment = build_environment(files, environment_settings, litter=settings.litter, latency=settings.latency)
    try:
        delay = 0.0 if unchanged_teacher else command_delay(environment)
        controller: Controller = build_controller(files.item, environment_settings, delay=delay)
        if any(controller_offset):
            controller = BiasedController(controller, controller_offset)
        key = {"files": files_digest(files), "controller_offset": list(controller_offset), "teacher": unchanged_teacher}
        makers = environment_makers(
            files, environment_settings, settings.environments, litter=settings.litter, latency=settings.latency
        )
        trainer = Trainer(environment, controller, settings, seed=seed, state=state, key=key, makers=makers)
        try:
            training = trainer.run(out)
        finally:
            trainer.close()
        onnx_error = export_onnx(out)
    finally:
        environment.close()
    seconds = {part: training.rows[-1][f"cpu_{part}_s"] for part in PARTS}
    write_stage(
        record,
        reasons=_reasons(files, training, trainer.agent.alarm.count),
        seed=seed,
        packages=("torch", "pybullet", "numba"),
        algo=settings.algo,
        task=environment_settings.task,
        renderer=environment_settings.renderer,
        success=training.best,
        retest_success=training.retest,
        controller_success=training.controller if settings.has_controller else None,
        steps=training.rows[-1]["step"],
        updates=training.rows[-1]["update"],
        target_alarms=trainer.agent.alarm.count,
        replay_mb=training.replay_bytes / 1e6,
        frames_per_second=training.frames_per_second,
        cpu_seconds=seconds,
        cpu_seconds_to_enough=cpu_seconds_to(training.rows, ENOUGH),
        onnx_error=onnx_error,
        controller_offset=list(controller_offset),
        unchanged_teacher=unchanged_teacher,
        settings=settings.model_dump(),
    )
    shutil.rmtree(state, ignore_errors=True)
    return training


def command_delay(environment: PickEnvironment) -> float:
    """Return by how many control periods commands act late in an environment on the simulated world, for the teacher's gain.

    It is the model's `arm.delay` and what effects of the model, such as `command_delay` and `lag`, add to it. The dead times
    that episodes draw do not count: the controller bears them with its usual gain.
    """
    world = environment.world
    assert isinstance(world, SimWorld)
    return world.controller.setup.latency * world.model.timing.control_hz


def cpu_seconds_to(rows: list[Row], success: float) -> float | None:
    """Return the CPU seconds until an evaluation first reached a success rate; None if none did.

    They include acting, learning and rendering, but not evaluations: the settings choose how many there are, and nothing is
    learned from them.
    """
    for row in rows:
        if (row["success"] or 0.0) >= success:
            return sum(float(row[f"cpu_{part}_s"] or 0.0) for part in PARTS if part != "evaluate")
    return None


def files_digest(files: StageFiles) -> str:
    """Return a digest of the content of all files of an environment, including all files beside an asset's record.

    Raises:
        InputError: A file is missing.
    """
    digest = hashlib.sha256()
    for item in fields(files):
        value = getattr(files, item.name)
        if isinstance(value, str | Path):
            for path in _content(Path(value)):
                digest.update(path.name.encode())
                digest.update(hashlib.sha256(path.read_bytes()).digest())
        else:
            digest.update(repr(value).encode())
    return digest.hexdigest()


def _content(path: Path) -> list[Path]:
    """List the files behind a path: the file itself, all files of a folder, or all files beside an `asset.json`."""
    if not path.exists():
        raise InputError(path, "it does not exist", "Run the rule that makes it")
    if path.name == "asset.json":
        path = path.parent
    return sorted(found for found in path.rglob("*") if found.is_file()) if path.is_dir() else [path]


def _reasons(files: StageFiles, training: Training, alarms: int) -> list[str]:
    """Return the reasons why a policy is degraded."""
    out = []
    for name in ("item", "background", "registration"):
        path = getattr(files, name)
        if path is not None and read_json(path).get("status") == "degraded":
            out.append(f"the {name} is degraded")
    if training.retest < POOR:
        out.append(f"it succeeds in {training.retest:.0%} of new starts in simulation")
    if alarms > RINGING * (training.rows[-1]["update"] or 0.0):
        out.append(f"critic targets exceeded the largest return in {alarms} updates")
    return out
