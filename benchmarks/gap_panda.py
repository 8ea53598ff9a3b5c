"""Diagnose a real Franka Emika Panda from logs of its torques, and compare its friction with what was published about it.

    git clone https://github.com/marcocognetti/FrankaEmikaPandaDynModel
    git -C FrankaEmikaPandaDynModel checkout 24d85ce
    git clone https://github.com/google-deepmind/mujoco_menagerie
    python -m benchmarks.gap_panda FrankaEmikaPandaDynModel mujoco_menagerie/franka_emika_panda/panda_nohand.xml \\
        --output results/benchmarks/gap_panda.json

The data stay where they are; that repository is under the GNU General Public License 3. One motion of 20 s at 1 kHz is cut in
three: 7 s to fit, 7 s to choose, the rest to judge. The model is the MJCF, whose masses are those of the supplement in that
repository; its `armature` and `damping` are the same at all joints, measured by nobody, and left out. Friction as published
stands in `get_FrictionTorque.m`: a smooth step of height A at each joint, A/2 for either direction. The repository does not say
from which motions, so that these figures are no truth, but another estimate.

Source: Gaz, Cognetti, Oliva, Robuffo Giordano, and De Luca, IEEE Robotics and Automation Letters 4, 2019.
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

JOINTS = tuple(f"joint{k}" for k in range(1, 8))
SPANS = {"fit": (0.2, 7.0), "select": (7.0, 14.0), "verify": (14.0, 20.8)}
"""First and last time of each record, s: the arm sets off at the very beginning."""

LOG, FRICTION = "matlab/data/Exciting_Traj/Trajectory_1/rbt_log", "matlab/dyn_model_panda/get_FrictionTorque.m"


def read(source: Path, what: str) -> Array:
    """Read one file of the log.

    Raises:
        InputError: The file is missing.
    """
    file = source / LOG / f"exciting_traj_{what}.txt"
    if not file.is_file():
        raise InputError(file, "the file is missing", "Name the clone that this script's docstring describes")
    return np.loadtxt(file)


def write_case(options: argparse.Namespace, folder: Path) -> Path:
    """Write the log as a user's case, and return the case's file.

    Raises:
        InputError: A file of the source is missing.
    """
    time = read(options.source, "time")
    kinds = {"position": ("positions", "rad"), "velocity": ("velocity", "rad/s"), "command": ("torques", "N m")}
    series = {kind: read(options.source, what).reshape(-1, len(JOINTS)) for kind, (what, _) in kinds.items()}
    for role, (first, last) in SPANS.items():
        part = (time >= first) & (time < last)
        table = {"time [s]": time[part] - time[part][0]}
        for kind, values in series.items():
            table |= {f"{kind}.{joint} [{kinds[kind][1]}]": values[part, k] for k, joint in enumerate(JOINTS)}
        pd.DataFrame(table).to_csv(folder / f"{role}.csv", index=False)
    nothing = [0.0] * len(JOINTS)
    model = {"mjcf": str(options.mjcf.resolve()), "joints": list(JOINTS), "controller": {"mode": "torque"}}
    model |= {"armature": nothing, "viscous": nothing}
    (folder / "model.yaml").write_text(yaml.safe_dump(model), encoding="utf-8")
    case = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in SPANS}}
    (folder / "case.yaml").write_text(yaml.safe_dump(case), encoding="utf-8")
    return folder / "case.yaml"


def known(options: argparse.Namespace) -> dict[tuple[str, str], float]:
    """Return the published Coulomb friction of each joint, N m, half of the step between the directions.

    Raises:
        InputError: The file is missing, or holds no such figures.
    """
    file = options.source / FRICTION
    found = re.search(r"fp = \[\.\.\.\s*([0-9.,]+);", file.read_text(encoding="utf-8")) if file.is_file() else None
    if found is None or len(steps := found[1].split(",")) != len(JOINTS):
        raise InputError(file, "there are no seven steps of friction", "Name the clone that this script's docstring describes")
    half = {joint: 0.5 * float(step) for joint, step in zip(JOINTS, steps, strict=True)}
    return {(name, joint): size for joint, size in half.items() for name in ("coulomb", "coulomb_asym")}


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose the arm; the exit status is 2 if the data are missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path, help="clone of the repository that holds the logs")
    parser.add_argument("mjcf", type=Path, help="the menagerie's panda_nohand.xml")
    return run(parser, arguments, write_case, known)


if __name__ == "__main__":
    sys.exit(main())
