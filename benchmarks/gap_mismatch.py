"""Diagnose an arm whose truth follows laws that the diagnosis does not have (tier T6 of the gap benchmark).

    python benchmarks/gap_mismatch.py --sizes 2 4 --output results/benchmarks/gap_mismatch.json
    GSBRIDGE_SEAL=4711 python benchmarks/gap_mismatch.py --output sealed.json

The mechanism is an arm of three joints under a PD controller without gravity compensation, with a description, inertias,
motions and sensors of its own. Its truth is simulated by MuJoCo alone, without the integrator that the diagnosis uses:

* `soft` takes steps of 0.25 ms, with dry friction as soft as MuJoCo's defaults make it.
* `stiff` takes steps of 50 us, with dry friction as hard as MuJoCo allows.

The hidden effects are twelve kinds from the catalogue in five sizes each (`KINDS`), pairs of them (`PAIRS`), and laws that the
catalogue lacks, though a person would call them by one of its names (`MISMATCHES`): LuGre and Dahl friction, very soft dry
friction, a delay that jitters. Cases without an effect (`FREE`) have white noise, filtered noise or coarse encoders. With
`GSBRIDGE_SEAL=NUMBER`, joints, sizes, signs, motions and noise are drawn from that number alone, else from `--seed`. Seals
above 10000 are for scoring.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import yaml
from numpy.typing import NDArray
from scipy.signal import lfilter

from gsbridge import logs
from gsbridge.files import write_json
from gsbridge.gap.diagnosis.results import LIKELY, NAMED

Array = NDArray[np.float64]

VARIABLE = "GSBRIDGE_SEAL"

JOINTS = ("yaw", "shoulder", "elbow")
STIFFNESS, DAMPING = (80.0, 80.0, 40.0), (5.0, 5.0, 2.0)
"""Gains of the controller: N m/rad, N m s/rad."""

ROTORS, VISCOUS = (0.02, 0.02, 0.01), (0.3, 0.3, 0.15)
"""Known inertias of the rotors, kg m2, and viscous losses, N m s/rad."""

LINKS = ((1.2, 0.05, 0.1, 0.004), (1.5, 0.15, 0.3, 0.012), (0.8, 0.12, 0.25, 0.005))
"""Of each link: mass (kg), distance of its centre from the joint (m), length (m), moment of inertia across it (kg m2)."""

RATE, SECONDS, PERIOD = 200.0, 5.0, 1e-3
"""Sampling rate of the logs (Hz), their length (s), and the controller's period (s)."""

NOISE = {"position": 1e-4, "velocity": 4e-3, "effort": 0.02}
"""Standard deviation of the noise of a sample: rad, rad/s, N m."""

KINDS: Mapping[str, tuple[float, float, tuple[str, ...]]] = {
    "coulomb": (0.06, 1.5, JOINTS), "viscous": (0.05, 1.2, JOINTS), "armature": (0.004, 0.1, JOINTS),
    "torque_gain": (0.01, 0.25, ("shoulder", "elbow")), "effort_offset": (0.06, 1.5, JOINTS),
    "encoder_offset": (0.002, 0.05, ("shoulder", "elbow")), "backlash": (0.001, 0.02, ("yaw",)),
    "link_mass": (0.01, 0.3, ("shoulder",)), "payload": (0.01, 0.5, ("",)), "command_delay": (0.001, 0.04, ("",)),
    "lag": (0.002, 0.05, ("",)), "base_tilt": (0.002, 0.06, ("",)),
}  # fmt: skip
"""Of each effect: smallest and largest size, SI units, and the joints that it may act on."""

PAIRS = (("coulomb:shoulder", "command_delay"), ("payload", "viscous:elbow"), ("backlash:yaw", "command_delay"))

MISMATCHES: Mapping[str, tuple[str, float, float]] = {
    "lugre": ("coulomb", 0.2, 1.2), "dahl": ("coulomb", 0.2, 1.2), "softest": ("coulomb", 0.2, 1.2),
    "jitter": ("command_delay", 0.008, 0.03),
}  # fmt: skip
"""Of each law that the catalogue lacks: the catalogue's name that a person would give it, and the range of its size (SI)."""

FREE = ("white", "filtered", "coarse")
"""Kinds of noise of cases in which nothing is hidden."""

DRAWS, FREE_DRAWS = 3, 10
"""Number of cases of each law in `MISMATCHES` and of each noise with an effect, and number of cases of each noise alone."""

STEPS = {"soft": 2.5e-4, "stiff": 5e-5}


@dataclass(frozen=True)
class Order:
    """A case to generate: hidden effects with sizes, the names that are right for them, the engine, and the sensors' noise."""

    kind: str
    hidden: Mapping[str, float]
    right: tuple[str, ...]
    engine: str
    noise: str
    seed: int


def urdf() -> str:
    """The arm as its maker describes it."""
    rows = ['<robot name="three"><link name="base"/>']
    above, place = "base", "0 0 0.1"
    for name, (mass, middle, length, moment), axis in zip(JOINTS, LINKS, ("0 0 1", "0 1 0", "0 1 0"), strict=True):
        rows.append(
            f'<link name="{name}_link"><inertial><origin xyz="0 0 {middle}"/><mass value="{mass}"/><inertia ixx="{moment}" '
            f'iyy="{moment}" izz="{0.1 * moment}" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="{name}" '
            f'type="continuous"><origin xyz="{place}"/><parent link="{above}"/><child link="{name}_link"/><axis xyz="{axis}"/>'
            "</joint>"
        )
        above, place = f"{name}_link", f"0 0 {length}"
    return "\n".join([*rows, "</robot>"])


def engine_model(hidden: Mapping[str, float], engine: str) -> mujoco.MjModel:
    """The arm in MuJoCo with the hidden effects that the engine can model; backlash is a joint of its own behind the motor."""

    def at(name: str, joint: str) -> float:
        return hidden.get(f"{name}:{joint}", 0.0)

    text, end = "", ""
    place = "0 0 0.1"
    for k, (name, (mass, middle, length, moment)) in enumerate(zip(JOINTS, LINKS, strict=True)):
        axis = "0 0 1" if k == 0 else "0 1 0"
        rotor, loss = ROTORS[k] + at("armature", name), VISCOUS[k] + at("viscous", name)
        dry = f'frictionloss="{at("coulomb", name) + at("softest", name)}"'
        if engine == "stiff":
            dry += ' solreffriction="0.0001 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
        elif at("softest", name):
            dry += ' solreffriction="0.06 1"'
        gap, scale = at("backlash", name), 1.0 + at("link_mass", name)
        text += f'<body name="{name}" pos="{place}">'
        end = "</body>" + end
        if gap:
            step = STEPS[engine]
            text += f'<joint name="{name}" axis="{axis}" armature="{rotor}" damping="{loss}" {dry}/>'
            text += '<inertial pos="0 0 0" mass="1e-6" '
            text += f'diaginertia="1e-9 1e-9 1e-9"/><body name="{name}_load"><joint name="{name}_play" axis="{axis}" '
            text += f'range="{-gap / 2} {gap / 2}" limited="true" solreflimit="{4 * step} 1"/>'
            end = "</body>" + end
        else:
            text += f'<joint name="{name}" axis="{axis}" armature="{rotor}" damping="{loss}" {dry}/>'
        text += f'<inertial pos="0 0 {middle}" mass="{mass * scale}" diaginertia="{moment * scale} {moment * scale} '
        text += f'{0.1 * moment * scale}"/>'
        place = f"0 0 {length}"
    if hidden.get("payload"):
        text += f'<body pos="0.02 0 0.2"><inertial pos="0 0 0" mass="{hidden["payload"]}" diaginertia="1e-9 1e-9 1e-9"/></body>'
    tilt = hidden.get("base_tilt", 0.0)
    gravity = f"{9.81 * np.sin(tilt) * 0.6} {9.81 * np.sin(tilt) * 0.8} {-9.81 * np.cos(tilt)}"
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian" autolimits="true"/><option timestep="{STEPS[engine]}" gravity="{gravity}"/>'
        f"<worldbody>{text}{end}</worldbody></mujoco>"
    )


def courses(rng: np.random.Generator) -> dict[str, Callable[[Array], Array]]:
    """Commanded postures of each record, as functions of times. [T] -> [T, 3]."""
    centre, reach = np.array([0.0, 0.7, 0.9]), np.array([0.8, 0.5, 0.6])

    def begun(time: Array) -> Array:
        share = np.clip(time / 0.6, 0.0, 1.0)[:, None]
        return share**2 * (3 - 2 * share)

    waves, sizes, phases = rng.uniform(0.15, 1.4, (5, 3)), rng.uniform(0.4, 1.0, (5, 3)), rng.uniform(0, 2 * np.pi, (5, 3))
    goals, slow, fast = rng.uniform(-1, 1, (8, 3)), rng.uniform(0.2, 0.4, 3), rng.uniform(0.9, 1.5, 3)

    def fit(time: Array) -> Array:
        wave = np.sin(2 * np.pi * waves * time[:, None, None] + phases) * (sizes / sizes.sum(axis=0))
        return centre + reach * begun(time) * wave.sum(axis=1)

    def select(time: Array) -> Array:
        place = np.clip(time / 0.7, 0.0, 6.99)
        number, share = place.astype(int), np.clip((place % 1.0)[:, None] / 0.6, 0.0, 1.0)
        share = share**3 * (10 - 15 * share + 6 * share**2)
        stops = np.concatenate([np.zeros((1, 3)), goals])
        return centre + reach * (stops[number] + (stops[number + 1] - stops[number]) * share)

    def verify(time: Array) -> Array:
        phase = 2 * np.pi * (slow * time[:, None] + 0.5 * (fast - slow) * time[:, None] ** 2 / SECONDS)
        return centre + 0.7 * reach * begun(time) * np.sin(phase)

    return {"fit": fit, "select": select, "verify": verify}


class _Rubbing:
    """Friction torque of a bristle model: Dahl's, or that of Canudas de Wit and others (LuGre) with a bump at low speed."""

    def __init__(self, size: float, lugre: bool) -> None:
        self.size, self.lugre, self.bent = size, lugre, 0.0
        self.stiff = size / 2e-3

    def __call__(self, speed: float, step: float) -> float:
        level = self.size * (1.0 + 0.6 * np.exp(-((speed / 0.05) ** 2))) if self.lugre else self.size
        # The exact solution for constant speed, since an explicit step cannot follow bristles this stiff.
        rate = self.stiff * abs(speed) / level
        rest = np.sign(speed) * level / self.stiff
        before, self.bent = self.bent, rest + (self.bent - rest) * np.exp(-rate * step)
        bristles = 0.3 * np.sqrt(self.stiff * 0.02) * (self.bent - before) / step if self.lugre else 0.0
        return float(self.stiff * self.bent + bristles)


def simulate(order: Order, course: Callable[[Array], Array], rng: np.random.Generator) -> tuple[Array, dict[str, Array]]:
    """Commands as they were sent, and what the arm's sensors would log without noise. [T, 3] each."""
    hidden, model = order.hidden, engine_model(order.hidden, order.engine)
    data, steps = mujoco.MjData(model), round(PERIOD / STEPS[order.engine])
    count = round(SECONDS / PERIOD)
    grid = np.arange(count) * PERIOD
    # Commands are sent and logged at the rate of the log, and joined by straight lines.
    sent_at = np.arange(round(SECONDS * RATE)) / RATE
    sent = course(sent_at)
    dead = np.full(count, hidden.get("command_delay", 0.0) + hidden.get("jitter", 0.0))
    if "jitter" in hidden:
        # The delay wanders like the length of a queue: it strays further upwards than downwards.
        wander = lfilter([0.05], [1.0, -0.95], rng.standard_gamma(1.0, count) - 1.0)
        dead *= 1.0 + 0.25 * wander / max(float(wander.std()), 1e-9)
    when = np.maximum(grid - np.maximum(dead, 0.0), 0.0)
    wanted = np.stack([np.interp(when, sent_at, column) for column in sent.T], axis=1)
    if hidden.get("lag"):
        keep = np.exp(-PERIOD / hidden["lag"])
        wanted = lfilter([1 - keep], [1, -keep], wanted, axis=0, zi=keep * wanted[:1])[0]
    rows = [model.joint(name).qposadr[0] for name in JOINTS]
    dofs = [model.joint(name).dofadr[0] for name in JOINTS]
    offset = np.array([hidden.get(f"encoder_offset:{name}", 0.0) for name in JOINTS])
    gain = 1.0 + np.array([hidden.get(f"torque_gain:{name}", 0.0) for name in JOINTS])
    push = np.array([hidden.get(f"effort_offset:{name}", 0.0) for name in JOINTS])
    rubs = {k: _Rubbing(hidden[f"{law}:{name}"], law == "lugre") for k, name in enumerate(JOINTS) for law in ("lugre", "dahl")
            if f"{law}:{name}" in hidden}  # fmt: skip
    data.qpos[rows] = wanted[0] - offset
    out = np.empty((3, count, 3))
    stiff, damp = np.array(STIFFNESS), np.array(DAMPING)
    # The arm settles under its controller for 1.5 s before the log begins.
    for number in range(-round(1.5 / PERIOD), count):
        step = STEPS[order.engine]
        v = data.qvel[dofs]
        q = data.qpos[rows] - 0.5 * step * v + offset
        asked = stiff * (wanted[max(number, 0)] - q) - damp * v
        if number >= 0:
            out[:, number] = q, v, asked
        data.qfrc_applied[dofs] = gain * asked + push
        if not rubs:
            mujoco.mj_step(model, data, nstep=steps)
            continue
        for _ in range(steps):
            data.qfrc_applied[dofs] = gain * asked + push
            for k, rub in rubs.items():
                data.qfrc_applied[dofs[k]] -= rub(float(data.qvel[dofs[k]]), step)
            mujoco.mj_step(model, data)
    logged = {
        kind: np.stack([np.interp(sent_at, grid, column) for column in values.T], axis=1)
        for kind, values in zip(("position", "velocity", "effort"), out, strict=True)
    }
    return sent, logged


def noisy(kind: str, values: Array, how: str, rng: np.random.Generator) -> Array:
    """Measurements with noise: `filtered` noise has passed a low pass in the sensor; `coarse` encoders step by 1.5 mrad."""
    sigma, shape = NOISE[kind], values.shape
    if how == "filtered":
        return values + sigma * lfilter([np.sqrt(1 - 0.81)], [1, -0.9], rng.standard_normal((shape[0] + 60, 3)), axis=0)[60:]
    if how == "coarse" and kind == "position":
        return np.round(values / 1.5e-3) * 1.5e-3
    return values + sigma * rng.standard_normal(shape)


def write_case(order: Order, folder: Path, course_seed: int) -> Path:
    """Write the files that a user would bring, and return the case's file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.urdf").write_text(urdf(), encoding="utf-8")
    model = {
        "urdf": "arm.urdf",
        "controller": {"mode": "pd", "rate": 1000, "stiffness": list(STIFFNESS), "damping": list(DAMPING), "between": "line"},
        "armature": list(ROTORS), "viscous": list(VISCOUS),
    }  # fmt: skip
    (folder / "model.yaml").write_text(yaml.safe_dump(model), encoding="utf-8")
    rng = np.random.default_rng(order.seed)
    for role, course in courses(np.random.default_rng(course_seed)).items():
        sent, logged = simulate(order, course, rng)
        table = {"time [s]": np.arange(len(sent)) / RATE}
        table |= {f"command.{name} [rad]": sent[:, k] for k, name in enumerate(JOINTS)}
        units = {"position": "rad", "velocity": "rad/s", "effort": "N m"}
        for kind, values in logged.items():
            seen = noisy(kind, values, order.noise, rng)
            table |= {f"{kind}.{name} [{units[kind]}]": seen[:, k] for k, name in enumerate(JOINTS)}
        pd.DataFrame(table).to_csv(folder / f"{role}.csv", index=False, float_format="%.8g")
    case = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in ("fit", "select", "verify")}}
    (folder / "case.yaml").write_text(yaml.safe_dump(case), encoding="utf-8")
    return folder / "case.yaml"


def orders(seed: int, engines: Sequence[str], sizes: Sequence[int]) -> list[Order]:
    """All cases of a draw. `sizes` are numbers from 1 to 5 on a logarithmic scale from the smallest size to the largest."""
    rng, out = np.random.default_rng([seed, 6]), list[Order]()

    def add(kind: str, hidden: Mapping[str, float], right: Sequence[str], engine: str, noise: str = "white") -> None:
        out.append(Order(kind, hidden, tuple(sorted(right)), engine, noise, int(rng.integers(2**31))))

    for engine in engines:
        for name, (low, high, where) in KINDS.items():
            for size in sizes:
                joint = str(rng.choice(where))
                value = low * (high / low) ** ((size - 1) / 4) * rng.uniform(0.8, 1.2)
                signed = name in ("torque_gain", "effort_offset", "encoder_offset", "link_mass", "base_tilt")
                label = f"{name}:{joint}" if joint else name
                add("single", {label: value * (rng.choice((-1, 1)) if signed else 1)}, [label], engine)
        for names in PAIRS:
            middle = {name: np.sqrt(np.prod(KINDS[name.split(":")[0]][:2])) * rng.uniform(0.8, 1.6) for name in names}
            add("pair", middle, names, engine)
        for law, (name, low, high) in MISMATCHES.items():
            for _ in range(DRAWS):
                joint = str(rng.choice(JOINTS)) if name == "coulomb" else ""
                label = f"{law}:{joint}" if joint else law
                add("mismatch", {label: rng.uniform(low, high)}, [f"{name}:{joint}" if joint else name], engine)
        for noise in FREE:
            for _ in range(FREE_DRAWS):
                add("free", {}, (), engine, noise)
        for _ in range(DRAWS):
            joint = f"coulomb:{rng.choice(JOINTS)}"
            add("noise", {joint: rng.uniform(0.3, 0.8)}, [joint], engine, "filtered")
            add("noise", {"command_delay": rng.uniform(0.01, 0.03)}, ["command_delay"], engine, "coarse")
    return out


def outcome(order: Order, findings: Mapping[str, Any]) -> str:
    """Grade of a finding: how its names compare with what was hidden."""
    verdict, right = findings["verdict"], frozenset(order.right)
    named = frozenset(f"{e['name']}:{e['joint']}" if e.get("joint") else e["name"] for e in findings["effects"])
    if not order.right:
        return "quiet" if verdict in ("no_discrepancy", "not_enough_excitation") else "false_alarm"
    if verdict == "named":
        # `part`: all that is named is there, but not all that is there is named.
        return "right" if named == right else "part" if named < right else "wrong"
    if verdict == "ambiguous":
        sets = [frozenset(item.split(" + ")) for item in findings["ambiguous"]]
        return "covered" if right in sets else "one_of_others"
    return "mute" if verdict == "none_of_the_known" else "missed"


def told(order: Order, entries: Sequence[Mapping[str, Any]]) -> str:
    """Grade of the account's first entry if it is named or likely, else `open`; a floor asks that such an entry is right."""
    if not entries or entries[0]["verdict"] not in (NAMED, LIKELY):
        return "open"
    return f"{'right' if entries[0]['label'] in order.right else 'wrong'}, {entries[0]['verdict']}"


def held(order: Order, entries: Sequence[Mapping[str, Any]]) -> dict[str, bool]:
    """Whether the account's 90 % interval holds the truth, by effect, for entries of one parameter about hidden effects."""
    out = {}
    # The lag's filter holds the newest command for a whole period, so it delays slow motion by less than its time constant.
    true = {name: PERIOD / np.expm1(PERIOD / value) if name == "lag" else value for name, value in order.hidden.items()}
    for entry in entries:
        rows = list(entry["parameters"].values())
        if entry["label"] in true and len(rows) == 1:
            low, high = rows[0]["interval90"]
            out[entry["label"]] = bool(low <= true[entry["label"]] <= high)
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases, and print one line for each and the counts of outcomes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help=f"of the draw, where {VARIABLE} is not set")
    parser.add_argument("--engines", nargs="+", choices=STEPS, default=["soft"])
    parser.add_argument("--sizes", nargs="+", type=int, choices=range(1, 6), default=[1, 2, 3, 4, 5])
    parser.add_argument("--kinds", nargs="+", help="of the cases; all without it: single, pair, mismatch, free, noise")
    parser.add_argument("--folder", type=Path, help="keeps cases and signatures; else a temporary one")
    parser.add_argument("--output", type=Path, help="JSON file of the figures")
    options = parser.parse_args(arguments)
    logs.start(0, None)
    seal = os.environ.get(VARIABLE)
    seed = options.seed if seal is None else int(seal)
    with TemporaryDirectory(prefix="gsbridge-mismatch-") as temporary:
        folder = options.folder or Path(temporary)
        rows = run(orders(seed, options.engines, options.sizes), options.kinds, folder, seed)
    counts, first = (_counted(rows, key) for key in ("outcome", "told"))
    if options.output:
        write_json(options.output, {"seed": seed, "sealed": seal is not None, "counts": counts, "first": first, "cases": rows})
    sys.stdout.write(json.dumps({"outcomes": counts, "first in the account": first}, indent=1) + "\n")
    return 0


def _counted(rows: Sequence[Mapping[str, Any]], key: str) -> dict[str, dict[str, int]]:
    """Number of cases of each engine and kind, by the value that their rows have under a key."""
    counts: dict[str, dict[str, int]] = {}
    for row in rows:
        kind = counts.setdefault(f"{row['engine']} {row['kind']}", {})
        kind[row[key]] = kind.get(row[key], 0) + 1
    return counts


def run(drawn: Sequence[Order], kinds: Sequence[str] | None, folder: Path, seed: int) -> list[dict[str, Any]]:
    """Diagnose the cases, and print one line for each."""
    from gsbridge.gap.joints.workflow import JointBackend

    rows = []
    for order in drawn:
        if kinds and order.kind not in kinds:
            continue
        # The folder's name depends on all that defines the case, so that files of another draw are not taken for it.
        case = folder / f"{order.engine}-{hashlib.sha256(f'{seed}{order}'.encode()).hexdigest()[:12]}"
        file = case / "case.yaml"
        if not file.exists():
            write_case(order, case, seed)
        begin = time.perf_counter()
        findings = JointBackend.read(file).diagnose(folder / "bank", 0)
        account = findings.get("account") or {"entries": [], "explained": None}
        first = account["entries"][0] if account["entries"] else None
        row = {
            "case": case.name, "engine": order.engine, "kind": order.kind, "noise": order.noise, "hidden": dict(order.hidden),
            "right": order.right, "outcome": outcome(order, findings), "verdict": findings["verdict"],
            "said": [f"{e['name']}:{e['joint']}" if e.get("joint") else e["name"] for e in findings["effects"]],
            "ambiguous": findings["ambiguous"], "first": first and first["label"],
            "first_verdict": first and first["verdict"],
            "first_right": first is not None and first["label"] in order.right, "told": told(order, account["entries"]),
            "explained": account["explained"],
            "held": held(order, account["entries"]),
            "before": findings["select"]["before"], "after": findings["select"]["after"],
            "simulations": findings["simulations"]["case"], "seconds": time.perf_counter() - begin,
        }  # fmt: skip
        rows.append(row)
        hidden = ", ".join(f"{name}={value:.3g}" for name, value in order.hidden.items()) or "nothing"
        sys.stdout.write(
            f"{order.engine} {order.kind} {hidden}: {row['outcome']} ({row['verdict']}: {'+'.join(row['said'])}"
            f"{' | ' + ' | '.join(row['ambiguous'][:4]) if row['ambiguous'] else ''}; first {row['first']} "
            f"({row['first_verdict']}), explained {row['explained']}; "
            f"{row['before']:.4g} -> {row['after']:.4g}); {row['simulations']} runs, "
            f"{row['seconds']:.0f} s\n"
        )
        sys.stdout.flush()
    return rows


if __name__ == "__main__":
    sys.exit(main())
