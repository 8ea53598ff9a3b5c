"""Diagnose a real UR10e from logs of its currents and positions alone, and compare its friction with its owners' estimate.

    git clone https://github.com/shamilmamedov/dynamic_calibration && git -C dynamic_calibration checkout 11af40e
    python -m benchmarks.gap_ur10e dynamic_calibration --output results/benchmarks/gap_ur10e.json

The data stay where they are; that repository states no licence. Three motions of 20 s at 100 Hz are taken: five harmonics to
fit, eight to choose, ten to judge. The model is the repository's URDF, which knows neither friction nor rotors, and the motors'
constants are those of its `UR10E_parameters.txt`. From the same file come the owners' viscous and Coulomb friction; it does not
say from which motions, so that these figures are no truth, but another estimate. The result is one JSON file, and a line for
each effect.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from benchmarks.gap_owners import run
from gsbridge.errors import InputError
from gsbridge.geometry import Array

JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
MOTIONS = {"fit": "ur-20_02_06-20sec_5harm", "select": "ur-20_02_05-20sec_8harm", "verify": "ur-20_02_06-20sec_10harm"}
LOGS, MODEL, OWNERS = "dataset_ur10e/identification_data", "URe/urdf/ur10e.urdf", "UR10E_parameters.txt"
SHOWN = {"viscous": 0, "coulomb": 1, "coulomb_asym": 1}
"""Effects whose sizes the owners state, and where: they state two for each joint, before an offset."""

_MOVING, _BESIDE = 0.01, 20
"""Speed, rad/s, from which on the arm moves, and samples that are kept before and behind the motion."""


def stated(folder: Path, name: str) -> Array:
    """Read a list of figures of the owners' file.

    Raises:
        InputError: The file is missing, or lacks the list.
    """
    file = folder / OWNERS
    found = re.search(rf"{name} = \[([^\]]*)\]", file.read_text(encoding="utf-8")) if file.is_file() else None
    if found is None:
        raise InputError(file, f"there is no list '{name}'", "Name the clone that this script's docstring describes")
    return np.array(found[1].split(), dtype=float)


def write_case(source: Path, folder: Path) -> Path:
    """Write the logs as a user's case, and return the case's file.

    Raises:
        InputError: A file of the source is missing.
    """
    for role, motion in MOTIONS.items():
        file = source / LOGS / f"{motion}.csv"
        if not file.is_file():
            raise InputError(file, "the file is missing", "Name the clone that this script's docstring describes")
        # Time, then positions, speeds, and currents of six joints; what follows is not used.
        log = np.loadtxt(file, delimiter=",")
        moving = np.flatnonzero(np.abs(log[:, 7:13]).max(axis=1) > _MOVING)
        log = log[max(moving[0] - _BESIDE, 0) : moving[-1] + _BESIDE]
        table = {"time [s]": log[:, 0] - log[0, 0]}
        for k, joint in enumerate(JOINTS):
            table[f"position.{joint} [rad]"] = log[:, 1 + k]
            table[f"velocity.{joint} [rad/s]"] = log[:, 7 + k]
            table[f"command.{joint} [A]"] = log[:, 13 + k]
        pd.DataFrame(table).to_csv(folder / f"{role}.csv", index=False)
    model = {"urdf": str((source / MODEL).resolve()), "joints": list(JOINTS), "controller": {"mode": "torque"}}
    (folder / "model.yaml").write_text(yaml.safe_dump(model), encoding="utf-8")
    case = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in MOTIONS}}
    case["torque_per_ampere"] = stated(source, "drvGains").tolist()
    (folder / "case.yaml").write_text(yaml.safe_dump(case), encoding="utf-8")
    return folder / "case.yaml"


def known(options: argparse.Namespace) -> dict[tuple[str, str], float]:
    """Return the owners' viscous and Coulomb friction, N m s/rad and N m; an offset beside them is left out."""
    figures = stated(options.source, "pi_frcn").reshape(len(JOINTS), 3)
    rows = dict(zip(JOINTS, figures, strict=True))
    return {(name, joint): float(row[k]) for joint, row in rows.items() for name, k in SHOWN.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose the arm; the exit status is 2 if the data are missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path, help="clone of the repository that holds the logs")
    return run(parser, arguments, lambda options, folder: write_case(options.source, folder), known)


if __name__ == "__main__":
    sys.exit(main())
