"""Further mechanisms, from a linear axis to a light arm: descriptions, controllers, and effects that may be hidden in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gsbridge.files import atomic_file
from gsbridge.gap.benchmark.generate import BenchmarkMechanism
from gsbridge.gap.benchmark.hidden_parts import WHEEL
from gsbridge.gap.benchmark.mujoco_truth import MujocoTruth
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel, read_mechanism_model

_SIGNED = {"torque_gain": 0.02, "effort_offset": 0.02, "link_mass": 0.02, "gain_p": 0.02, "gain_d": 0.02,
           "encoder_offset": 2e-3, "encoder_scale": 0.01, "coulomb_asym": 0.05, "warming": 0.03}  # fmt: skip
_POSITIVE = {"viscous": 0.05, "coulomb": 0.05, "stribeck": 0.05, "armature": 5e-3, "spring": 0.1, "quadratic_drag": 0.05,
             "saturation": 0.1, "backlash": 2e-3, "compliance": 1e-3, "eccentricity": 2e-3, "load_friction": 0.02,
             "rate_limit": 1.0, "ripple": 0.05, "torque_delay": 1e-3, "torque_lag": 1e-3}  # fmt: skip
_WHOLE = {"command_delay": (1e-3, 1), "lag": (1e-3, 1), "clock_offset": (1e-3, 0), "clock_drift": (5e-4, 0),
          "payload": (0.02, 1), "base_tilt": (5e-3, 0), "gravcomp": (0.01, 0)}  # fmt: skip

EFFECTS = (*_SIGNED, *_POSITIVE, *_WHOLE)
"""Effects of driven joints that may be hidden."""

NEVER_HIDDEN = ("damping", "table")
"""Effects of the catalogue that are never hidden yet. Cases can show only that they are named wrongly, not rightly."""

_LENGTH = ("encoder_offset", "backlash", "eccentricity")
_FORCE = ("effort_offset", "coulomb", "coulomb_asym", "stribeck", "ripple", "detent", "kicks")
_POWERS = {"viscous": 2, "armature": 2, "spring": 2, "quadratic_drag": 3, "saturation": -1, "rate_limit": 1, "compliance": -2,
           "cubic_spring": 4, "stop": 2, "hysteresis": 2, "sagging": -1}  # fmt: skip
"""Powers of one over the wheel's radius that convert a size at a revolute joint to one at a prismatic joint."""

LARGEST = {"backlash": 0.05, "compliance": 0.02, "eccentricity": 0.05, "load_friction": 0.4, "ripple": 5.0,
           "torque_delay": 0.015, "torque_lag": 0.03, "warming": 0.1, "coulomb_asym": 10.0, "rate_limit": 40.0,
           "torque_gain": 0.5, "link_mass": 0.5, "gain_p": 0.5, "gain_d": 0.5, "gravcomp": 0.3, "encoder_offset": 0.1,
           "encoder_scale": 0.1, "base_tilt": 0.1, "effort_offset": 10.0, "coulomb": 10.0, "stribeck": 5.0, "viscous": 20.0,
           "quadratic_drag": 20.0, "armature": 1.0, "spring": 20.0, "payload": 5.0, "command_delay": 0.15, "lag": 0.1,
           "clock_offset": 0.05, "clock_drift": 0.02}  # fmt: skip
"""Largest plausible sizes, SI; beyond them, the machine is broken."""

UNKNOWN_OF = {
    "development": {"cubic_spring": 0.1, "shaking": 0.05, "patchy_friction": 0.05, "kicks": 0.5},
    "scored": {"detent": 0.1, "hysteresis": 1.0, "drifting": 2e-3, "sagging": 0.05, "stop": 1.0, "slip": 2e-3},
}
"""Effects outside the catalogue by split, with the start size of the search, SI; none is in both splits."""

LOGGED = ("position", "velocity", "effort")

RATES = (50.0, 100.0, 200.0, 500.0, 1000.0)
"""Rates of the logs, Hz."""

DURATIONS = (2.01, 4.0, 8.0, 20.0, 60.0)
"""Lengths of the records, s."""

_SAMPLES = 20000
"""Largest number of samples of a record."""


@dataclass(frozen=True)
class Machine:
    """A chain of links.

    Args:
        links: For each link: name of its joint, `revolute` or `prismatic`, axis, origin in the previous link's frame (m), mass
            (kg), centre of mass (m) and moments of inertia (kg m2).
        stiffness: Stiffnesses of the controller, N m/rad or N/m.
        damping: Dampings of the controller, N m s/rad or N s/m.
        armature: Inertias of the rotors, kg m2 or kg.
        viscous: Known viscous friction, N m s/rad or N s/m.
        coulomb: Known dry friction, N m or N.
        carried: Share of the weight that the controller compensates.
        centre: Middle posture, rad or m.
        reach: Largest commanded distance from the middle posture, rad or m.
        effort: Standard deviations of the noise of efforts, N m or N.
    """

    links: tuple[tuple[str, str, str, str, float, str, tuple[float, float, float]], ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    armature: tuple[float, ...]
    viscous: tuple[float, ...]
    coulomb: tuple[float, ...]
    carried: float
    centre: tuple[float, ...]
    reach: tuple[float, ...]
    effort: tuple[float, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(link[0] for link in self.links)

    @property
    def sliding(self) -> tuple[str, ...]:
        """Names of the prismatic joints."""
        return tuple(link[0] for link in self.links if link[1] == "prismatic")


MACHINES: Mapping[str, Machine] = {
    "axis": Machine(
        (("turn", "revolute", "0 -1 0", "0 0 0", 1.0, "0.2 0 0", (1e-3, 0.02, 0.02)),),
        (60.0,), (4.0,), (0.01,), (0.1,), (0.0,), 1.0, (0.3,), (0.9,), (0.02,),
    ),
    "pendulum": Machine(
        (("swing", "revolute", "0 1 0", "0 0 1", 0.8, "0 0 -0.3", (0.01, 0.01, 1e-3)),),
        (12.0,), (0.8,), (0.004,), (0.02,), (0.05,), 0.0, (0.4,), (1.2,), (0.01,),
    ),
    "slide": Machine(
        (("carriage", "prismatic", "1 0 0", "0 0 0.5", 4.0, "0 0 0.05", (0.02, 0.02, 0.02)),),
        (6000.0,), (300.0,), (0.8,), (15.0,), (2.0,), 0.0, (0.1,), (0.12,), (0.3,),
    ),
    "scara": Machine(
        (
            ("shoulder", "revolute", "0 0 1", "0 0 0.4", 3.0, "0.15 0 0", (5e-3, 0.03, 0.03)),
            ("elbow", "revolute", "0 0 1", "0.3 0 0", 2.0, "0.12 0 0", (3e-3, 0.015, 0.015)),
            ("quill", "prismatic", "0 0 -1", "0.25 0 0", 0.8, "0 0 -0.1", (2e-3, 2e-3, 4e-4)),
        ),
        (400.0, 200.0, 5000.0), (25.0, 10.0, 180.0), (0.08, 0.04, 0.6), (0.8, 0.5, 12.0), (0.2, 0.1, 1.5), 0.0,
        (0.2, 0.6, 0.05), (0.8, 0.9, 0.04), (0.05, 0.04, 0.4),
    ),
    "arm3": Machine(
        (
            ("yaw", "revolute", "0 0 1", "0 0 0.1", 1.2, "0 0 0.05", (4e-3, 4e-3, 4e-4)),
            ("lift", "revolute", "0 1 0", "0 0 0.1", 1.5, "0 0 0.15", (0.012, 0.012, 1.2e-3)),
            ("elbow", "revolute", "0 1 0", "0 0 0.3", 0.8, "0 0 0.12", (5e-3, 5e-3, 5e-4)),
        ),
        (80.0, 80.0, 40.0), (5.0, 5.0, 2.0), (0.02, 0.02, 0.01), (0.3, 0.3, 0.15), (0.0, 0.0, 0.0), 0.0,
        (0.0, 0.7, 0.9), (0.8, 0.5, 0.6), (0.02, 0.02, 0.02),
    ),
    "light5": Machine(
        (
            ("pan", "revolute", "0 0 1", "0 0 0.06", 0.15, "0 0 0.02", (1e-4, 1e-4, 1e-4)),
            ("lift", "revolute", "0 1 0", "0 0 0.05", 0.12, "0 0 0.06", (1.5e-4, 1.5e-4, 3e-5)),
            ("elbow", "revolute", "0 1 0", "0 0 0.115", 0.11, "0 0 0.07", (1.5e-4, 1.5e-4, 3e-5)),
            ("bend", "revolute", "0 1 0", "0 0 0.135", 0.08, "0 0 0.03", (6e-5, 6e-5, 2e-5)),
            ("roll", "revolute", "0 0 1", "0 0 0.06", 0.09, "0.01 0 0.04", (8e-5, 8e-5, 3e-5)),
        ),
        (16.0, 16.0, 16.0, 10.0, 10.0), (0.6, 0.6, 0.6, 0.35, 0.35), (0.028,) * 5, (0.06,) * 5, (0.05,) * 5, 0.0,
        (0.0, 0.4, 0.8, 0.3, 0.0), (0.8, 0.5, 0.6, 0.7, 0.9), (0.01,) * 5,
    ),
}  # fmt: skip
"""The machines: an axis with gravity compensation, a pendulum without, a linear axis, a SCARA, an arm of three joints without
gravity compensation, and a light arm of five joints, modelled on the servo arms that hobbyists print."""


@dataclass(frozen=True)
class Logging:
    """How a machine is recorded.

    Args:
        machine: One of `MACHINES`.
        rate: Sampling rate, Hz.
        duration: Length of each record, s.
        channels: Channels that are logged.
    """

    machine: str
    rate: float
    duration: float
    channels: tuple[str, ...]


def drawn_logging(course_seed: int) -> Logging:
    """Draw a machine and how it is recorded from the seed of its courses; consecutive seeds cycle through all machines."""
    rng = np.random.default_rng([course_seed, 5])
    name = list(MACHINES)[course_seed % len(MACHINES)]
    rate, duration = float(rng.choice(RATES)), float(rng.choice(DURATIONS))
    while rate * duration > _SAMPLES or (rate < 100.0 and duration < 4.0):
        rate, duration = float(rng.choice(RATES)), float(rng.choice(DURATIONS))
    return Logging(name, rate, duration, LOGGED if rng.random() < 0.6 else LOGGED[:2])


def machine_model(name: str, folder: str | Path) -> Path:
    """Write `machine.urdf` and `model.yaml` of a machine, and return the path of the model."""
    folder, machine = Path(folder), MACHINES[name]
    rows, above = ['<robot name="machine"><link name="base"/>'], "base"
    for joint, kind, axis, origin, mass, centre, (xx, yy, zz) in machine.links:
        rows.append(
            f'<link name="{joint}_link"><inertial><origin xyz="{centre}"/><mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}" '
            f'izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="{joint}" type="{kind}"><origin '
            f'xyz="{origin}"/><parent link="{above}"/><child link="{joint}_link"/><axis xyz="{axis}"/>'
            '<limit lower="-6" upper="6" effort="10000" velocity="50"/></joint>'
        )
        above = f"{joint}_link"
    with atomic_file(folder / "machine.urdf") as temporary:
        temporary.write_text("\n".join([*rows, "</robot>"]), encoding="utf-8")
    model: dict[str, Any] = {
        "urdf": "machine.urdf",
        "controller": {
            "mode": "pd", "rate": 1000, "stiffness": list(machine.stiffness), "damping": list(machine.damping),
            "gravity_compensation": machine.carried, "between": "line",
        },
        "armature": list(machine.armature), "viscous": list(machine.viscous), "coulomb": list(machine.coulomb), "effects": [],
    }  # fmt: skip
    with atomic_file(folder / "model.yaml") as temporary:
        temporary.write_text(yaml.safe_dump(model, sort_keys=False), encoding="utf-8")
    return folder / "model.yaml"


def machine_plant(name: str, folder: str | Path) -> tuple[MechanismModel, BenchmarkMechanism]:
    """Return a machine's model and the simulator of its true motion.

    Args:
        name: One of `MACHINES`.
        folder: Folder to which the model is written.
    """
    machine, system = MACHINES[name], read_mechanism_model(machine_model(name, folder))
    slides = np.array([joint in machine.sliding for joint in machine.joints])
    sizes: dict[str, tuple[float, int]] = dict(_WHOLE)
    if not machine.carried:
        sizes.pop("gravcomp")
    known = [(_SIGNED, 0), (_POSITIVE, 1), *((family, 1) for family in UNKNOWN_OF.values())]
    for joint in machine.joints:
        for family, sign in known:
            for effect, start in family.items():
                # An eccentric encoder exists at revolute joints only.
                if not (joint in machine.sliding and effect == "eccentricity"):
                    sizes[f"{effect}:{joint}"] = (start * scale_of(effect) if joint in machine.sliding else start, sign)
    noise = {
        "position": np.where(slides, 2e-5, 2e-4),
        "velocity": np.where(slides, 5e-4, 5e-3),
        "effort": np.array(machine.effort),
    }
    largest = dict(LARGEST)
    for joint in machine.sliding:
        largest |= {f"{effect}:{joint}": size * scale_of(effect) for effect, size in LARGEST.items()}
    plant = BenchmarkMechanism(
        system.joints, np.array(machine.centre), np.array(machine.reach), noise, MujocoTruth(system), sizes, largest
    )
    return system, plant


def scale_of(effect: str) -> float:
    """Return the factor that converts an effect's size at a revolute joint to one at a prismatic joint."""
    power = -1 if effect in _LENGTH else 1 if effect in _FORCE else _POWERS.get(effect, 0)
    return float(WHEEL**-power)


def names_of(plant: BenchmarkMechanism, split: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the effects that may be hidden in a split: those of the catalogue, and those outside it.

    Args:
        plant: The machine.
        split: One of `gsbridge.gap.benchmark.case_plan.SPLITS`.
    """
    odd = {name for family in UNKNOWN_OF.values() for name in family}
    known = tuple(name for name in plant.sizes if name.split(":")[0] not in odd)
    strange = tuple(name for name in plant.sizes if name.split(":")[0] in UNKNOWN_OF[split])
    return known, strange
