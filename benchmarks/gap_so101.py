"""Diagnose a real arm: what the description of an SO-101 lacks, learnt from some motions and judged on others.

    export GSBRIDGE_MEASURED=/path/to/measured GSBRIDGE_ROBOTS=/path/to/robots
    python benchmarks/gap_so101.py --output results/benchmarks/gap_so101.json

The data stay where they are: `measured/so101/logs` (isaac-sim2real/sage at 4ffd262) and `robots/so101/so101.urdf`
(TheRobotStudio/SO-ARM100), both Apache-2.0. Each motion holds what was commanded and what six servos
measured, 50 times a second. The servos are position controllers without an integral, whose gains nobody states in N m/rad.

Like a user who does not know the arm, this starts from the description and three motions:

1. Sign and zero of each joint: commanded minus measured position is the deflection of the servo's spring under the arm's
   weight. Signs, and zeros in quarter turns, are tried; the description's own stay unless others explain clearly more.
2. Stiffness of the servos: from the same deflection.
3. A case like any user's (`docs/gap.md`, Your own arm), diagnosed with one motion to fit, one to choose, one to verify.
4. The account is judged on all other motions: by the deviation of the measured motion from the original model, root mean square
   over joints and time, and by what is left of it once the account is in the model.

`--turns` lets the three motions change their roles, to see whether the account stays the same.
"""

from __future__ import annotations

import argparse
import gzip
import itertools
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
import yaml
from numpy.typing import NDArray

from gsbridge import logs
from gsbridge.errors import InputError
from gsbridge.files import write_json
from gsbridge.gap.joints.mechanism.chain import Chain
from gsbridge.gap.joints.mechanism.dynamics import place, weights
from gsbridge.gap.joints.mechanism.inertials import Skeleton

Array = NDArray[np.float64]

MEASURED, ROBOTS = "GSBRIDGE_MEASURED", "GSBRIDGE_ROBOTS"

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
"""Joints in the order of the logs' columns. The sixth column, the jaw, is left out: it is a share of its opening, no angle."""

ROLES = ("fit", "select", "verify")
MOTIONS = ("boundary_exploration", "random_waypoints", "multisine")
"""Motions to fit, to choose and to verify: the whole workspace, waypoints, and many frequencies at once."""

LONGEST = 60.0
"""Length of the part of a motion that a diagnosis uses, s; the rest of that motion is not used."""

ROTOR = 0.02
"""Inertia of motor and gear of such a servo seen from the joint, kg m2."""

DAMPED = 0.03
"""Time by which a servo of this kind lags behind slow motion, s; its damping is the stiffness times this time."""

CLEAR = 0.8
"""Other signs and zeros are taken only if they leave less than this share of what the description's own leave unexplained."""

TURN, SLOW = np.pi / 2, 0.01
"""Step in which zeros are tried, rad, and speed below which a command counts as standing still, rad/s."""


@dataclass(frozen=True)
class Motion:
    """One log: times (s) [T], commanded and measured positions (rad) [T, 5]."""

    name: str
    time: Array
    command: Array
    position: Array

    def until(self, seconds: float) -> Motion:
        """Its samples up to a time, s."""
        rows = self.time <= seconds
        return Motion(self.name, self.time[rows], self.command[rows], self.position[rows])


def read_motion(folder: Path) -> Motion:
    """Read a motion of the data set.

    Raises:
        InputError: A file is missing.
    """
    tables = []
    for name in ("control.csv", "state_motor.csv"):
        path = folder / f"{name}.gz" if (folder / f"{name}.gz").exists() else folder / name
        if not path.exists():
            raise InputError(path, "the motion is not there", f"Name the folder that holds so101 in {MEASURED}")
        with gzip.open(path, "rt") if path.suffix == ".gz" else path.open(encoding="utf-8") as stream:
            tables.append(pd.read_csv(stream))
    sent, seen = (np.array([json.loads(text) for text in table["positions"]])[:, : len(JOINTS)] for table in tables)
    time, sent_at = (table["timestamp"].to_numpy() * 1e-6 for table in reversed(tables))
    # The command that was sent last before each measurement.
    rows = (np.searchsorted(sent_at, time + 1e-6, side="right") - 1).clip(0)
    fresh = np.diff(time, prepend=-1.0) > 0
    return Motion(folder.name, (time - time[0])[fresh], sent[rows][fresh], seen[fresh])


class Statics:
    """Computes the torques that hold the arm in a posture, from its description."""

    def __init__(self, urdf: Path) -> None:
        skeleton = Skeleton.read(urdf, JOINTS)
        self._chain = Chain.of(skeleton, JOINTS)
        self._bodies = self._chain.bodies(skeleton.inertials)

    def __call__(self, postures: Array) -> Array:
        """Holding torques, N m, of postures, rad. [K, N] -> [K, N]."""
        chain, count = self._chain, len(JOINTS)
        out = np.empty((len(postures), count))
        turn, origin, axis = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3))
        work, hold = np.empty((count, 18)), np.empty(count)
        gravity = np.array([0.0, 0.0, -9.81])
        for row, q in zip(out, np.ascontiguousarray(postures[:, chain.order]), strict=True):
            place(chain.parents, chain.fixed, chain.axes, chain.slides, q, turn, origin, axis)
            weights(chain.parents, chain.slides, self._bodies, gravity, turn, origin, axis, work, hold)
            row[chain.order] = hold
        return out


@dataclass(frozen=True)
class Start:
    """Map from logged angles to the description's: signs, zeros (rad); and the servos' stiffness (N m/rad). [N] each."""

    signs: Array
    zeros: Array
    stiffness: Array
    explained: dict[str, float]

    def to_urdf(self, values: Array) -> Array:
        """Logged angles in the description's signs and zeros, rad. [T, N] -> [T, N]."""
        return values * self.signs + self.zeros


def find_start(motions: Sequence[Motion], urdf: Path) -> Start:
    """Signs, zeros and stiffness from how far the servos give way under the arm's weight."""
    statics, rows = Statics(urdf), [_slow(motion) for motion in motions]
    q, bend, way, speed = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    count = len(JOINTS)
    nominal = statics(q)
    heavy = [k for k in range(count) if np.abs(nominal[:, k]).max() > 0.1 * np.abs(nominal).max()]
    best, own = None, np.inf
    for signs in itertools.product((1.0, -1.0), repeat=len(heavy)):
        for turns in itertools.product((0.0, TURN, -TURN), repeat=len(heavy)):
            sign, zero = np.ones(count), np.zeros(count)
            sign[heavy], zero[heavy] = signs, turns
            torque = statics(q * sign + zero) * sign
            left, softness = zip(*(_bend(torque[:, k], bend[:, k], way[:, k], speed[:, k]) for k in heavy), strict=True)
            if best is None:
                # The first combination is the description's own.
                own = sum(left)
            if best is None or sum(left) < min(best[0], CLEAR * own):
                best = (sum(left), sign, zero, left, softness)
    assert best is not None
    _, sign, zero, left, softness = best
    known = {k: 1.0 / value for k, value in zip(heavy, softness, strict=True) if value > 0.0}
    if not known:
        raise InputError(urdf, "no joint bends under its weight", "State the stiffness of the servos")
    middle = float(np.median(list(known.values())))
    stiffness = np.array([np.clip(known.get(k, middle), 0.3 * middle, 3.0 * middle) for k in range(count)])
    explained = {JOINTS[k]: 1.0 - value for k, value in zip(heavy, left, strict=True)}
    return Start(sign, zero, stiffness, explained)


def _slow(motion: Motion, count: int = 200) -> tuple[Array, Array, Array, Array]:
    """Posture and deflection (rad), direction and speed (rad/s) of the command, at some times of a motion. [K, N] each.

    The deflection is the commanded minus the measured position; the direction is that of the last motion (-1, 0, 1).
    """
    speed = np.gradient(motion.command, motion.time, axis=0)
    way = np.where(np.abs(speed) > SLOW, np.sign(speed), np.nan)
    way = pd.DataFrame(way).ffill().fillna(0.0).to_numpy()
    rows = np.arange(0, len(motion.time), max(1, len(motion.time) // count))
    return motion.position[rows], (motion.command - motion.position)[rows], way[rows], speed[rows]


def _bend(torque: Array, bend: Array, way: Array, speed: Array) -> tuple[float, float]:
    """Share of a joint's deflection that weight, friction and lag do not explain, and its servo's compliance, rad/(N m).

    Args:
        torque: Holding torque by the description, N m. [K].
        bend: Deflection, rad. [K].
        way: Direction of the last motion, which stands for friction. [K].
        speed: Speed of the command, rad/s, which stands for lag. [K].
    """
    others = np.stack([way, speed], axis=1)
    softness = max(float(np.linalg.lstsq(np.column_stack([torque, others]), bend, rcond=None)[0][0]), 0.0)
    rest = bend - softness * torque
    rest = rest - others @ np.linalg.lstsq(others, rest, rcond=None)[0]
    return float((rest**2).mean() / max((bend**2).mean(), 1e-12)), softness


def write_case(motions: Mapping[str, Motion], start: Start, urdf: Path, folder: Path) -> Path:
    """Write the motions as a user's case, in the description's angles, and return the case's file."""
    folder.mkdir(parents=True, exist_ok=True)
    for role, motion in motions.items():
        columns = {"time [s]": motion.time}
        for kind, values in (("command", motion.command), ("position", motion.position)):
            columns |= {f"{kind}.{joint} [rad]": column for joint, column in zip(JOINTS, start.to_urdf(values).T, strict=True)}
        pd.DataFrame(columns).to_csv(folder / f"{role}.csv", index=False, float_format="%.7g")
    stiffness = [round(float(value), 3) for value in start.stiffness]
    model = {
        "urdf": str(urdf.resolve()), "joints": list(JOINTS),
        "controller": {"mode": "pd", "rate": 250, "stiffness": stiffness,
                       "damping": [round(DAMPED * value, 4) for value in stiffness], "between": "hold"},
        "armature": ROTOR, "physics_rate": 250,
    }  # fmt: skip
    (folder / "model.yaml").write_text(yaml.safe_dump(model), encoding="utf-8")
    case = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in motions}}
    (folder / "case.yaml").write_text(yaml.safe_dump(case), encoding="utf-8")
    return folder / "case.yaml"


def judge(motion: Motion, start: Start, model: Path, amended: Path, folder: Path) -> dict[str, Any]:
    """Root mean square deviation of a motion from the original and from the amended model, rad."""
    from gsbridge.gap.formats.logs import read_log
    from gsbridge.gap.formats.records import Layout
    from gsbridge.gap.joints.first_states import state_at
    from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
    from gsbridge.gap.joints.mechanism.mechanism_model import read_mechanism_model
    from gsbridge.gap.joints.mechanism.replay import Mechanism
    from gsbridge.gap.joints.residuals import spans_of

    write_case({"judged": motion}, start, model, folder / "judged")
    sizes, joints = [], []
    for path in (model, amended):
        system = read_mechanism_model(path)
        record = read_log(folder / "judged" / "judged.csv", Layout(system.joints))
        mechanism, spans = Mechanism(system), spans_of(record, system)
        moved = mechanism.run(record, apply_effects(mechanism, ()), spans, [state_at(record, first) for first, _ in spans])
        apart = record.measured["position"] - moved["position"]
        sizes.append(float(np.sqrt((apart**2).mean())))
        joints.append(np.sqrt((apart**2).mean(axis=0)).tolist())
    before, after = sizes
    return {"motion": motion.name, "before": before, "after": after, "explained": 1.0 - after / before,
            "joints_before": joints[0], "joints_after": joints[1]}  # fmt: skip


def diagnose(
    measured: Path, robots: Path, motions: Sequence[str], folder: Path, judged: Sequence[str] | None
) -> dict[str, Any]:
    """Diagnose three motions, and judge the account on motions that the diagnosis has not seen."""
    from gsbridge.gap.workflow import run_case

    source, urdf = measured / "so101" / "logs", robots / "so101" / "so101.urdf"
    if not source.is_dir() or not urdf.exists():
        raise InputError(source, "the measured motions or the arm's description are not there", f"Set {MEASURED}, {ROBOTS}")
    used = {role: read_motion(source / name).until(LONGEST) for role, name in zip(ROLES, motions, strict=True)}
    start = find_start(list(used.values()), urdf)
    case = write_case(used, start, urdf, folder)
    findings = run_case(case, folder / "out", folder / "bank")
    names = [path.name for path in sorted(source.iterdir()) if path.name not in motions]
    rows = [
        judge(read_motion(source / name), start, folder / "model.yaml", folder / "out" / "model.yaml", folder)
        for name in names
        if judged is None or name in judged
    ]
    shares = [row["explained"] for row in rows]
    account = findings.get("account") or {"entries": [], "explained": None}
    return {
        "motions": list(motions), "signs": start.signs, "zeros": start.zeros, "stiffness": start.stiffness,
        "bend_explained": start.explained, "verdict": findings["verdict"], "sentence": findings["sentence"],
        "account": [
            {"label": e["label"], "share": e["share"], "verdict": e["verdict"], "alternatives": e["alternatives"],
             "parameters": {name: row["value"] for name, row in e["parameters"].items()}}
            for e in account["entries"]
        ],
        "explained_verify": account["explained"], "simulations": findings["simulations"], "seconds": findings["seconds"],
        "median": float(np.median(shares)) if shares else None, "worst": min(shares, default=None), "judged": rows,
    }  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose, and judge on other motions; the exit status is 2 if data are missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--measured", type=Path, default=os.environ.get(MEASURED), help=f"folder of the data; else ${MEASURED}")
    parser.add_argument("--robots", type=Path, default=os.environ.get(ROBOTS), help=f"folder of descriptions; else ${ROBOTS}")
    parser.add_argument("--motions", nargs=3, default=MOTIONS, metavar=ROLES, help="to fit, to choose, to verify")
    parser.add_argument("--turns", type=int, default=1, choices=(1, 2, 3), help="how often the three change their roles")
    parser.add_argument("--judged", nargs="+", help="motions that are judged; all others of the folder without it")
    parser.add_argument("--output", type=Path, help="JSON file of the figures")
    options = parser.parse_args(arguments)
    if options.measured is None or options.robots is None:
        parser.error(f"name the folders by --measured and --robots, or {MEASURED} and {ROBOTS}")
    logs.start(1, None)
    out = []
    for turn in range(options.turns):
        motions = [options.motions[(k + turn) % 3] for k in range(3)]
        with TemporaryDirectory(prefix="gsbridge-so101-") as folder:
            try:
                found = diagnose(options.measured, options.robots, motions, Path(folder), options.judged)
            except InputError as error:
                sys.stderr.write(f"{error}\n")
                return 2
        out.append(found)
        sys.stdout.write(f"{' / '.join(motions)}: {found['verdict']}. {found['sentence']}\n")
        for entry in found["account"]:
            sys.stdout.write(f"  {entry['label']}: {100 * entry['share']:.1f} % ({entry['verdict']}) {entry['parameters']}\n")
        for row in found["judged"]:
            sizes = f"{1e3 * row['before']:.1f} -> {1e3 * row['after']:.1f} mrad"
            sys.stdout.write(f"  {row['motion']}: {sizes}, {100 * row['explained']:.0f} %\n")
        sys.stdout.write(f"  median {found['median']}, worst {found['worst']}\n")
        sys.stdout.flush()
    if options.output:
        write_json(options.output, {"turns": out})
    return 0


if __name__ == "__main__":
    sys.exit(main())
