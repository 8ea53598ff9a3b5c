"""Stages of the closed loop about the arm, as the workflow runs them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import yaml

from gsbridge.files import atomic_file, read_json, write_stage
from gsbridge.gap.formats.yaml_file import read_yaml
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.loop.arm import write_arm
from gsbridge.gap.loop.calibrate import FIGURES, calibrate, calibrated_model
from gsbridge.registration.result import read_registration
from gsbridge.robot.assembly import RobotFiles
from gsbridge.sim.model import read_model


def describe_arm(robot: str | Path, registration: str | Path, model: str | Path, urdf: str | Path, out: str | Path) -> None:
    """Write the simulated arm as a mechanism for the gap workflow.

    Args:
        robot: Folder of the robot's description.
        registration: File `registration.json`.
        model: File of the simulation's model.
        urdf: File to write the arm's description to.
        out: File to write the arm's model to, in the same folder.
    """
    placed = read_registration(registration).base_from_table
    write_arm(RobotFiles.read(robot), read_model(model), placed, urdf, out)


def write_loop_case(
    model: str | Path, records: Mapping[str, str], out: str | Path, calibration: str | Path | None = None
) -> None:
    """Write a case about the arm for the gap workflow.

    Args:
        model: File of the arm's model.
        records: Files of the logs, by role.
        out: File to write the case to.
        calibration: Record of the calibration that made the model, whose residuals then count as noise; None for none.
    """
    folder = Path(out).resolve().parent
    content = {
        "model": _relative(model, folder),
        "records": {role: _relative(path, folder) for role, path in records.items()},
    }
    if calibration is not None:
        content["noise"] = read_json(calibration)["floor"]
    with atomic_file(out) as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None), encoding="utf-8")


def calibrate_arm(case: str | Path, model: str | Path, record: str | Path) -> None:
    """Calibrate the arm's model on a case's records.

    Args:
        case: File of the case; its model is the arm as simulated.
        model: File to write the calibrated model to, in the folder of the case's model, whose URDF it shares.
        record: File to write the stage's record to.

    Raises:
        InputError: The case cannot be used.
    """
    found = read_joint_case(case)
    done = calibrate(found.system, found.records)
    content = calibrated_model(read_yaml(found.model, "model", "docs/gap.md"), done)
    with atomic_file(model) as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None), encoding="utf-8")
    write_stage(
        record,
        reasons=found.reasons,
        packages=("numpy", "scipy", "numba"),
        joints=list(found.system.joints),
        figures={name: done.figures[name].tolist() for name in FIGURES},
        deviations={name: done.deviations[name].tolist() for name in FIGURES},
        delay=done.delay,
        delay_deviation=done.delay_deviation,
        before=dict(done.before),
        after=dict(done.after),
        floor={kind: values.tolist() for kind, values in done.floor.items()},
        simulations=done.runs,
        seconds=done.seconds,
        records={role: item.digest for role, item in found.records.items()},
    )


def _relative(path: str | Path, folder: Path) -> str:
    """Return a path relative to a folder."""
    return Path(os.path.relpath(Path(path).resolve(), folder)).as_posix()
