"""The simulated arm as a mechanism for the gap workflow: the same description, controller and losses.

The simulation's `arm.stiffness`, `arm.armature` and so on become the controller and loss entries of a model as users write
it. If the simulation was amended before, its delay becomes an effect, and its effects on joints are copied.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.gap.joints.mechanism.inertials import Skeleton
from gsbridge.geometry import Array
from gsbridge.robot.assembly import RobotFiles
from gsbridge.sim.item_setup import ItemSetup
from gsbridge.sim.model import Model


def write_arm(robot: RobotFiles, model: Model, base_from_table: Array, urdf: str | Path, out: str | Path) -> None:
    """Write the simulated arm: its description without shapes, and its model.

    Args:
        robot: The robot's files.
        model: The simulation model.
        base_from_table: Registered pose of the table in the base frame; the direction of gravity follows from it. [4, 4].
        urdf: File to write the description to.
        out: File to write the model to, in the same folder.

    Raises:
        InputError: The description cannot be used.
    """
    urdf, out = Path(urdf), Path(out)
    joints = tuple(robot.record["arm_joints"])
    skeleton = Skeleton.read(robot.urdf, joints)
    _hold_open(skeleton.tree, robot)
    with atomic_file(urdf) as temporary:
        skeleton.write(temporary, skeleton.inertials)
    with atomic_file(out) as temporary:
        content = arm_content(robot, model, base_from_table, urdf.name)
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None), encoding="utf-8")


def arm_content(robot: RobotFiles, model: Model, base_from_table: Array, urdf: str) -> dict[str, Any]:
    """Return the content of the model that `write_arm` writes.

    Args:
        robot: The robot's files.
        model: The simulation model.
        base_from_table: Registered pose of the table in the base frame. [4, 4].
        urdf: File name of the description, which lies beside the model.
    """
    arm, joints = model.arm, list(robot.record["arm_joints"])
    limits = [float(robot.record["limits"][name]["effort"]) for name in joints]
    down = np.asarray(base_from_table)[:3, :3] @ [0.0, 0.0, -ItemSetup(model).figures["gravity"]]
    effects: list[dict[str, Any]] = []
    if arm.delay:
        effects.append({"name": "command_delay", "parameters": {"time": arm.delay}})
    effects += [applied.record() for applied in model.effects_on("joint", "mechanism")]
    return {
        "urdf": urdf,
        "joints": joints,
        "gravity": [float(value) for value in down],
        "controller": {
            "mode": "pd",
            "rate": model.timing.physics_hz,
            "stiffness": list(arm.stiffness),
            "damping": list(arm.damping),
            "gravity_compensation": arm.gravity_compensation,
            "torque_limit": limits,
            # The driver logs every cycle of its loop, and each command holds until the next one.
            "between": "hold",
        },
        "viscous": list(arm.viscous_friction),
        "coulomb": [0.0] * len(joints),
        "armature": list(arm.armature),
        "physics_rate": model.timing.physics_hz,
        # Step as the simulation's engine does, so that the gap is that of the simulation and not of the exact equations.
        "scheme": "euler",
        "effects": effects,
    }


def _hold_open(tree: ElementTree.Element, robot: RobotFiles) -> None:
    """Turn the fingers' frames so that the hand is open at zero, where joints that are not driven are held."""
    angle = float(robot.record["gripper"]["open_angle"])
    for joint in tree.findall("joint"):
        factor = robot.record["gripper"]["joints"].get(joint.get("name"))
        if factor is None:
            continue
        origin, axis = joint.find("origin"), joint.find("axis")
        if origin is None or axis is None:
            raise InputError(
                robot.urdf, f"the finger joint '{joint.get('name')}' has no origin or axis", "Build the robot again"
            )
        fixed = Rotation.from_euler("xyz", _floats(origin.get("rpy", "0 0 0")))
        turned = fixed * Rotation.from_rotvec(factor * angle * _floats(axis.get("xyz", "1 0 0")))
        origin.set("rpy", " ".join(repr(float(value)) for value in turned.as_euler("xyz")))


def _floats(text: str) -> Array:
    return np.array([float(value) for value in text.split()])
