"""Mechanisms of the benchmark: a single axis and an arm, each with its model and the effects that may be hidden in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pybullet_data
import yaml

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.gap.benchmark.axis_truth import AXIS, NAMES, run_axis
from gsbridge.gap.benchmark.bullet_truth import BulletTruth
from gsbridge.gap.benchmark.generate import BenchmarkMechanism, Truth
from gsbridge.gap.benchmark.mujoco_truth import MujocoTruth
from gsbridge.gap.joints.mechanism.inertials import Skeleton
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel, read_mechanism_model
from gsbridge.geometry import Array

_LEVER = 0.2
"""Distance of the centre of mass from the axis, m."""

UNKNOWN = ("cubic_spring", "shaking", "patchy_friction")
"""Effects outside the catalogue of the diagnosis that the split `development` hides in axis and arm."""

UNKNOWN_OF = {"development": (*UNKNOWN, "kicks"), "scored": ("detent", "hysteresis", "drifting", "sagging", "stop", "slip")}
"""Names of the effects outside the catalogue by split; none is in both."""

_AXIS_UNKNOWN = {"development": UNKNOWN, "scored": ("detent", "stop")}

SIGNED = ("torque_gain", "effort_offset", "link_mass", "gain_p", "gain_d", "encoder_offset", "encoder_scale", "cubic_spring")
"""Effects that are hidden in one joint, with either sign."""

POSITIVE = ("viscous", "coulomb", "armature", "spring", "quadratic_drag", "saturation", "patchy_friction", "shaking",
            "kicks", *UNKNOWN_OF["scored"])  # fmt: skip
"""Effects that are hidden in one joint, with a positive size."""

LARGEST = {
    "torque_gain": 0.5, "link_mass": 0.5, "gain_p": 0.5, "gain_d": 0.5, "gravcomp": 0.3, "encoder_offset": 0.1,
    "encoder_scale": 0.1, "base_tilt": 0.1, "effort_offset": 10.0, "coulomb": 10.0, "stribeck": 5.0, "viscous": 20.0,
    "quadratic_drag": 20.0, "armature": 1.0, "spring": 20.0, "payload": 5.0, "command_delay": 0.15, "lag": 0.1,
    "clock_offset": 0.05, "clock_drift": 0.02,
}  # fmt: skip
"""Largest plausible sizes, SI. Where an effect hardly shows, a size of twenty units can mean a broken machine."""


def axis_model(folder: str | Path) -> Path:
    """Write `axis.urdf` and `model.yaml` of the single axis, and return the path of the model."""
    folder = Path(folder)
    mass = AXIS["moment"] / _LEVER
    across = AXIS["inertia"] - mass * _LEVER**2
    urdf = f"""<robot name="axis">
  <link name="base"/>
  <link name="arm">
    <inertial>
      <origin xyz="{_LEVER} 0 0"/>
      <mass value="{mass}"/>
      <inertia ixx="0.001" iyy="{across}" izz="{across}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="axis" type="revolute">
    <parent link="base"/>
    <child link="arm"/>
    <axis xyz="0 -1 0"/>
    <limit lower="-6" upper="6" effort="50" velocity="20"/>
  </joint>
</robot>
"""
    with atomic_file(folder / "axis.urdf") as temporary:
        temporary.write_text(urdf, encoding="utf-8")
    model = {"urdf": "axis.urdf", "controller": controller(AXIS["stiffness"], AXIS["damping"]), "effects": []}
    with atomic_file(folder / "model.yaml") as temporary:
        temporary.write_text(yaml.safe_dump(model, sort_keys=False), encoding="utf-8")
    return folder / "model.yaml"


def controller(stiffness: Any, damping: Any) -> dict[str, Any]:
    """Return the settings of the controller: 1 kHz, linear interpolation between commands, full gravity compensation."""
    return {
        "mode": "pd",
        "rate": 1000,
        "stiffness": stiffness,
        "damping": damping,
        "gravity_compensation": 1.0,
        "between": "line",
    }


def axis_plant(folder: str | Path, engine: str = "analytic") -> tuple[MechanismModel, BenchmarkMechanism]:
    """Return model and truth of the axis, simulated by its equation (`analytic`) or in MuJoCo (`mujoco`)."""
    system = read_mechanism_model(axis_model(folder))
    truth: Truth = run_axis if engine == "analytic" else MujocoTruth(system)
    sizes = {name: (0.01, 0 if name in (*SIGNED, "gravcomp") else 1) for name in NAMES}
    sizes |= {"saturation": (0.2, 1), "command_delay": (1e-3, 1), "lag": (1e-3, 1), "clock_offset": (1e-3, 0)}
    sizes |= {"clock_drift": (5e-4, 0)}
    noise = {"position": np.array([2e-4]), "velocity": np.array([5e-3]), "effort": np.array([0.02])}
    return system, BenchmarkMechanism(system.joints, np.array([0.3]), np.array([0.9]), noise, truth, sizes, LARGEST)


def arm_plant(system: MechanismModel, centre: Sequence[float], reach: Sequence[float]) -> BenchmarkMechanism:
    """Return an arm whose truths are simulated in MuJoCo.

    Args:
        system: Model of the arm.
        centre: Middle posture, rad. [N].
        reach: Largest commanded distance from the middle posture, rad. [N].
    """
    sizes = {"command_delay": (1e-3, 1), "lag": (1e-3, 1), "clock_offset": (1e-3, 0), "payload": (0.05, 1)}
    sizes |= {"clock_drift": (5e-4, 0)}
    sizes |= {"base_tilt": (5e-3, 0), "gravcomp": (0.01, 0)}
    for joint in system.joints:
        sizes |= {f"{name}:{joint}": (0.05, 1) for name in POSITIVE} | {f"{name}:{joint}": (0.02, 0) for name in SIGNED}
    count = len(system.joints)
    noise: dict[str, Array] = {
        "position": np.full(count, 2e-4),
        "velocity": np.full(count, 5e-3),
        "effort": np.full(count, 0.05),
        "tool": np.full(3, 2e-4),
    }
    return BenchmarkMechanism(
        system.joints, np.asarray(centre, float), np.asarray(reach, float), noise, MujocoTruth(system), sizes, LARGEST
    )


_ARM: dict[str, Any] = {
    "joints": tuple(f"lbr_iiwa_joint_{k}" for k in range(1, 8)),
    "controller": ([600, 600, 400, 400, 100, 60, 20], [40, 40, 25, 25, 4, 2, 0.3]),
    "viscous": [2.0, 2.0, 1.0, 1.0, 0.2, 0.1, 0.02],
    "centre": [0.0, 0.4, 0.0, -1.2, 0.0, 0.8, 0.0],
    "reach": 0.5,
    "tool": "lbr_iiwa_link_7",
}
"""The arm of the benchmark, an iiwa: controller gains, known viscous friction, middle posture, and tracked link."""


def arm_model(folder: str | Path) -> Path:
    """Write `arm.urdf`, without shapes, and `model.yaml` of the arm, and return the path of the model."""
    folder = Path(folder)
    source = Path(pybullet_data.getDataPath()) / "kuka_iiwa" / "model.urdf"
    skeleton = Skeleton.read(source, _ARM["joints"])
    with atomic_file(folder / "arm.urdf") as temporary:
        skeleton.write(temporary, skeleton.inertials)
    model = {"urdf": "arm.urdf", "joints": list(_ARM["joints"]), "controller": controller(*_ARM["controller"])}
    model |= {"viscous": _ARM["viscous"], "tool": _ARM["tool"], "effects": []}
    with atomic_file(folder / "model.yaml") as temporary:
        temporary.write_text(yaml.safe_dump(model, sort_keys=False), encoding="utf-8")
    return folder / "model.yaml"


@dataclass(frozen=True)
class MechanismSite:
    """A mechanism from which cases are drawn.

    Args:
        kind: `axis`, `arm` or `machine`.
        system: The model that is diagnosed.
        plant: The true mechanism.
        names: Effects of the catalogue that may be hidden.
        strange: Effects outside the catalogue that may be hidden.
        folder: Name of the model's folder.
        rate: Sampling rate of the logs, Hz.
    """

    kind: str
    system: MechanismModel
    plant: BenchmarkMechanism
    names: tuple[str, ...]
    strange: tuple[str, ...]
    folder: str
    rate: float = 100.0


def mechanism_site(tier: str, folder: str | Path, split: str = "development") -> MechanismSite:
    """Write the model of a tier's mechanism, and return the mechanism.

    Args:
        tier: `t0`, `t1` or `t2`.
        folder: Folder in which `axis` or `arm` is created with the model.
        split: One of `gsbridge.gap.benchmark.case_plan.SPLITS`; the effects outside the catalogue depend on it.

    Raises:
        InputError: `tier` is another one.
    """
    if tier == "t0":
        system, plant = axis_plant(Path(folder) / "axis")
        odd = {name for family in _AXIS_UNKNOWN.values() for name in family}
        return MechanismSite("axis", system, plant, tuple(n for n in NAMES if n not in odd), _AXIS_UNKNOWN[split], "axis")
    if tier not in ("t1", "t2"):
        raise InputError("benchmark", f"there is no tier '{tier}'", "Use t0, t1 or t2")
    system = read_mechanism_model(arm_model(Path(folder) / "arm"))
    truth: Truth = BulletTruth(system) if tier == "t1" else MujocoTruth(system)
    plant = replace(arm_plant(system, _ARM["centre"], [_ARM["reach"]] * len(system.joints)), truth=truth)
    # PyBullet has no rotor inertia. The arm's first axis is upright, so that an offset of its encoder has no effect.
    missing = {"armature"} if tier == "t1" else set()
    odd = {name for family in UNKNOWN_OF.values() for name in family}
    names = [
        name
        for name in plant.sizes
        if name.split(":")[0] not in {*odd, *missing} and name != f"encoder_offset:{system.joints[0]}"
    ]
    strange = tuple(name for name in plant.sizes if name.split(":")[0] in UNKNOWN_OF[split])
    return MechanismSite("arm", system, plant, tuple(names), strange, "arm")
