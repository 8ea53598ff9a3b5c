"""Implementation of `gsbridge run-policy`: reads the files and runs a policy on an arm."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gsbridge.environment.build import StageFiles, build_renderer, camera_response, lens_of
from gsbridge.environment.env import DrawnEye
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.errors import InputError
from gsbridge.given import read_given_json
from gsbridge.policy.driver import RobotDriver, WallClock, load_driver
from gsbridge.policy.episode_log import EpisodeLog
from gsbridge.policy.export import SPEC, Policy, load_policy
from gsbridge.policy.interface import PolicyInterface
from gsbridge.policy.onnx import OnnxPolicy, load_onnx
from gsbridge.policy.robot_trials import Person, StartPose, TrialFile, Verdict, start_poses, still_to_try
from gsbridge.policy.runner import Setup
from gsbridge.policy.safety import Limits
from gsbridge.policy.session import Operator, Plan, WorldOperator, run_session
from gsbridge.policy.worlds import MirrorDriver, MirrorSetting, SimDriver, WorldDriver
from gsbridge.reading import refusing
from gsbridge.registration.result import Registration, read_registration

logger = logging.getLogger("gsbridge")

WORLDS = ("sim", "mirror")
MOST_STEPS = 100_000
"""Largest number of steps that can be asked for in one episode: more than an hour."""


@dataclass(frozen=True)
class Deployment:
    """Choices of `gsbridge run-policy`.

    Args:
        policy: Folder of `policy.json` and the weights.
        driver: `sim`, `mirror`, or `module:Class`.
        registration: `registration.json`.
        options: Arguments of the user's own driver.
        results: Folder of the workflow's results; needed for `sim` and `mirror`.
        item, background: Names of the scenes of object and table; needed for `sim` and `mirror`.
        model: Simulation model; needed for `sim`.
        seed: Seed of the mirror: of its films and hidden parameters.
        pieces: Folder that keeps the mirror's convex pieces from run to run.
        runtime: Library that computes the network: `torch` or `onnx`.
        pose_set, index: Start poses, see `start_poses`; None for one episode that is no trial.
        trials: File to add trials to.
        redo: Whether to repeat trials that the file already holds.
        out: Folder of logs.
        pictures: Whether to keep pictures in the logs.
        steps: Steps of an episode; None for as many as in the training.
        dry_run: Whether to give no commands.
    """

    policy: Path
    driver: str
    registration: Path
    options: Mapping[str, Any] = field(default_factory=dict)
    results: Path | None = None
    item: str | None = None
    background: str | None = None
    model: Path | None = None
    seed: int = 0
    pieces: Path | None = None
    runtime: str = "torch"
    pose_set: str | None = None
    index: str | None = None
    trials: Path | None = None
    redo: bool = False
    out: Path | None = None
    pictures: bool = False
    steps: int | None = None
    dry_run: bool = False

    def __post_init__(self) -> None:
        if (self.pose_set is None) != (self.index is None):
            raise InputError("start poses", "one of --pose-set and --index is missing", "Give both, or none")
        if self.pose_set is None and (self.trials is not None or self.driver in WORLDS):
            raise InputError("start poses", "it is not said where the object starts", "Give --pose-set and --index")
        if self.trials is not None and self.dry_run:
            raise InputError("trials", "a dry run is no trial", "Leave out --trials or --dry-run")
        if self.pictures and self.out is None:
            raise InputError("pictures", "there is no folder to keep them in", "Give --out")
        if self.steps is not None and not 1 <= self.steps <= MOST_STEPS:
            raise InputError("steps", f"{str(self.steps)[:20]} is no number of steps", f"Give 1 to {MOST_STEPS}")
        if not 0 <= self.seed < 2**32:
            raise InputError("seed", f"{str(self.seed)[:20]} is no seed", "Give that of config.yaml")


def deploy(wanted: Deployment, ask: Callable[[str], str]) -> list[tuple[EpisodeLog, Verdict | None]]:
    """Run a policy as a deployment asks for.

    Args:
        wanted: The choices of the user.
        ask: Shows a question to the person beside the arm and returns the answer.

    Returns:
        Log and verdict of each episode.

    Raises:
        InputError: Files, driver and policy do not belong together; see `run_policy`.
    """
    # Find all that can be wrong with the files before an arm moves.
    read_given_json(wanted.policy / SPEC, "Name the folder of a trained policy, or copy it once more from where it was trained")
    trained = load_policy(wanted.policy)
    interface = PolicyInterface.of(trained.spec)
    facts = {
        "policy": str(wanted.policy),
        "policy_sha256": trained.spec["sha256"],
        "task": interface.settings.task,
        "driver": wanted.driver,
        "runtime": wanted.runtime,
        "registration": str(wanted.registration),
    }
    policy: Policy | OnnxPolicy = load_onnx(wanted.policy) if wanted.runtime == "onnx" else trained
    read_given_json(wanted.registration, "Name the registration of this arm, or register again: see docs/registration.md")
    registration = read_registration(wanted.registration)
    for reason in registration.reasons:
        logger.warning("the registration is degraded: %s", reason)
    plan = _plan(wanted, interface, trained.spec["sha256"])
    driver = _driver(wanted, interface, registration)
    try:
        operator: Operator
        if isinstance(driver, WorldDriver):
            # A world has its own clock, since it is only as fast as its processor; its pictures have no noise and may repeat.
            setup = Setup(interface, driver, registration, driver.clock, Limits(frozen=None))
            operator = WorldOperator(driver, interface.settings)
        else:
            setup = Setup(interface, driver, registration, WallClock(), Limits())
            operator = Person(interface.settings.task, ask, None if wanted.dry_run else driver.rest)
        return run_session(policy, setup, operator, plan, facts)
    finally:
        close = getattr(driver, "close", None)
        if close is not None:
            close()


def _plan(wanted: Deployment, interface: PolicyInterface, policy: str) -> Plan:
    """Collect start poses, files and switches, and check that logs can be written; `policy` is the digest of its weights."""
    if wanted.trials is not None and wanted.steps is not None and wanted.steps < interface.settings.time_out:
        problem = f"with {wanted.steps} of {interface.settings.time_out} steps, an episode is no trial"
        raise InputError("--steps", problem, "Leave out --steps or --trials")
    file = None if wanted.trials is None else TrialFile(wanted.trials, policy)
    # An arm must not move for results that cannot be written.
    for name, folder in (("--out", wanted.out), ("--trials", None if file is None else file.path.parent)):
        if folder is not None:
            _make_room(folder, name)
    poses: list[StartPose] = []
    if wanted.pose_set is not None and wanted.index is not None:
        poses = start_poses(interface.settings, wanted.pose_set, wanted.index)
    poses = still_to_try(poses, file, redo=wanted.redo)
    return Plan(poses, wanted.out, file, wanted.steps, wanted.dry_run, wanted.pictures)


def _make_room(folder: Path, option: str) -> None:
    """Make a folder for the results of a run.

    Args:
        folder: The folder.
        option: Option that named the folder, for the message.

    Raises:
        InputError: Nothing can be written there.
    """
    with refusing(folder, f"{option} cannot be written there", "Name another place"):
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder):
            pass


def _driver(wanted: Deployment, interface: PolicyInterface, registration: Registration) -> RobotDriver:
    """Make the driver of the arm or world."""
    if wanted.driver not in WORLDS:
        return load_driver(wanted.driver, wanted.options)
    if wanted.options:
        raise InputError("driver", f"{wanted.driver} takes no --option", "Options are for drivers of your own")
    results, item, background = wanted.results, wanted.item, wanted.background
    if results is None or item is None or background is None:
        raise InputError(
            "driver", f"{wanted.driver} needs scenes to build its world of", "Give --results, --object and --background"
        )
    if wanted.driver == "mirror":
        mirror = MirrorSetting(item, background, wanted.seed, pieces=wanted.pieces)
        return MirrorDriver(mirror.build(), registration, interface.settings)
    if wanted.model is None:
        raise InputError("driver", "sim needs a model of the simulation", "Give --model, such as models/nominal.yaml")
    files = StageFiles(
        robot=results / "robot" / "description",
        item=results / "scenes" / item / "asset" / "asset.json",
        background=results / "scenes" / background / "asset" / "asset.json",
        model=wanted.model,
        robot_splats=results / "robot" / "splats",
        registration=wanted.registration,
        photometry=results / "workspace" / "photometry.json",
        light=results / "workspace" / "light.json",
    )
    return simulated_arm(files, interface.settings)


def simulated_arm(files: StageFiles, settings: EnvironmentSettings) -> WorldDriver:
    """Make the simulated world as an arm; its camera shows the model's effects, as in the training of a policy.

    Args:
        files: Files that the world is made of; their registration is the one that the runner uses.
        settings: Settings of the policy's environment: picture size and renderer.

    Raises:
        InputError: A file is missing, of the wrong kind or damaged.
    """
    driver = SimDriver(files, settings)
    driver.eye = DrawnEye(build_renderer(files, settings), camera_response(files), lens_of(files, settings))
    driver.camera = wrist_camera(driver.eye.size)
    return driver
