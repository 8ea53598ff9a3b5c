"""Conversion of MuJoCo models (MJCF) to URDF descriptions: bodies, joints and mass properties as MuJoCo itself compiles them.

A model with a feature that a description of rigid links and joints cannot express is refused. Shapes, contacts, actuators and
sensors are left out.

Source: https://mujoco.readthedocs.io/en/stable/XMLreference.html
"""

from __future__ import annotations

import logging
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.robot.links import Inertia, inertial_element, number, numbers, origin_element, translation

logger = logging.getLogger("gsbridge")

_KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): "revolute", int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic"}
_LOOSE = {int(mujoco.mjtJoint.mjJNT_FREE): "free", int(mujoco.mjtJoint.mjJNT_BALL): "ball"}


def is_mjcf(root: ElementTree.Element) -> bool:
    """Whether an XML file is MJCF."""
    return root.tag == "mujoco"


def description_of_mjcf(path: str | Path) -> ElementTree.Element:
    """Return the root element of a URDF with the links and joints of an MJCF.

    The frame of a joint has its origin at the joint's anchor, and the axes that its body has at joint value zero. Two
    attributes are not part of URDF: `armature`, kg m2, of the element `dynamics`, and `gravity`, m/s2, of the root.

    Raises:
        InputError: MuJoCo cannot read the file, or a tree of links on hinges and slides cannot express its content.
    """
    # Without a handler, MuJoCo writes its warnings into a file in the current folder.
    warnings: list[str] = []
    mujoco.set_mju_user_warning(warnings.append)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(path, f"MuJoCo cannot read it ({' '.join(str(error).split())})", "Correct the MJCF") from error
    finally:
        mujoco.set_mju_user_warning(None)
    for message in warnings:
        # MuJoCo would treat NaN as a value that is not stated.
        if "NaN" in message:
            raise InputError(path, "a number of it is NaN", "Correct the MJCF")
        logger.warning("%s: %s", path, message)
    _refuse(model, path)
    without = bool(model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY))
    gravity = np.zeros(3) if without else model.opt.gravity
    root = ElementTree.Element("robot", name=Path(path).stem, gravity=numbers(gravity))
    # Pose of each body's own frame in the frame of its link, whose origin is the anchor of the link's joint.
    link_from_body: list[Array] = [np.eye(4)] * model.nbody
    names = [_name(model, mujoco.mjtObj.mjOBJ_BODY, k, "body") for k in range(model.nbody)]
    for k, name in enumerate(names):
        first, count = int(model.body_jntadr[k]), int(model.body_jntnum[k])
        place = _pose(model.body_pos[k], model.body_quat[k])
        parent = int(model.body_parentid[k])
        at = link_from_body[parent] @ place
        above = names[parent]
        for number_of, j in enumerate(range(first, first + count)):
            child = name if number_of == count - 1 else f"{name}_{number_of + 1}"
            anchor = translation(*model.jnt_pos[j])
            _add_joint(root, model, j, (above, child), at @ anchor @ _zero(model, j))
            if child != name:
                ElementTree.SubElement(root, "link", name=child).append(_massless())
            at, above = np.linalg.inv(anchor), child
        if k > 0 and count == 0:
            _add_fixed(root, above, name, at)
            at = np.eye(4)
        link_from_body[k] = at if count else np.eye(4)
        link = ElementTree.SubElement(root, "link", name=name)
        if k > 0:
            link.append(_inertial(model, k, link_from_body[k]))
    return root


def _refuse(model: mujoco.MjModel, path: str | Path) -> None:
    """Refuse a model that a tree of links on hinges and slides cannot express.

    Raises:
        InputError: The first feature that cannot be expressed, and what to do about it.
    """
    for j in range(model.njnt):
        name, kind = _name(model, mujoco.mjtObj.mjOBJ_JOINT, j, "joint"), int(model.jnt_type[j])
        if kind in _LOOSE:
            raise InputError(
                path,
                f"'{name}' is a {_LOOSE[kind]} joint",
                "A diagnosis knows hinges and slides: fix the base, or split the joint",
            )
        low, high = model.jnt_range[j]
        if low > high:
            # MuJoCo treats such a range as no range.
            raise InputError(path, f"joint '{name}' has a range from {low:g} to {high:g}", "Write the smaller limit first")
        if float(model.jnt_stiffness[j]) != 0.0:
            raise InputError(
                path, f"joint '{name}' has a spring (stiffness {float(model.jnt_stiffness[j]):g})",
                "Take it out, and write it into the model as the effect 'spring'",
            )  # fmt: skip
    lifted = np.flatnonzero(model.body_gravcomp)
    if len(lifted):
        body = _name(model, mujoco.mjtObj.mjOBJ_BODY, int(lifted[0]), "body")
        raise InputError(
            path, f"gravity does not act whole on body '{body}' (gravcomp)",
            "Take it out; where the controller bears the weight, state 'gravity: [0, 0, 0]' in the model",
        )  # fmt: skip
    if model.neq:
        raise InputError(
            path, f"it has {model.neq} constraints of <equality>", "A diagnosis knows open chains only: take them out"
        )
    if model.ntendon:
        raise InputError(path, f"it has {model.ntendon} tendons", "Couplings of joints are not known here: take them out")
    if not model.njnt:
        raise InputError(path, "it has no joint", "Give the MJCF of a mechanism")
    # MuJoCo itself only warns of numbers that are not finite.
    for what in (
        "body_pos",
        "body_quat",
        "body_mass",
        "body_inertia",
        "body_ipos",
        "jnt_pos",
        "jnt_axis",
        "jnt_range",
        "qpos0",
    ):
        if not np.isfinite(getattr(model, what)).all():
            raise InputError(path, f"a number of it is not finite ({what})", "Give numbers")


def _name(model: mujoco.MjModel, kind: mujoco.mjtObj, k: int, what: str) -> str:
    """Return the name of a body or a joint; without a name, `what` and its index."""
    return mujoco.mj_id2name(model, kind, k) or f"{what}_{k}"


def _pose(place: Array, quaternion: Array) -> Array:
    """Return the transform of MuJoCo's position, m, and quaternion (w first). [4, 4]."""
    out = np.eye(4)
    out[:3, 3], out[:3, :3] = place, Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return out


def _zero(model: mujoco.MjModel, j: int) -> Array:
    """Return the pose of a joint's frame at joint value zero, in its frame as the file poses it (joint value `ref`). [4, 4]."""
    back, axis = -float(model.qpos0[model.jnt_qposadr[j]]), model.jnt_axis[j]
    if _KINDS[int(model.jnt_type[j])] == "prismatic":
        return translation(*(back * axis))
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(back * axis).as_matrix()
    return out


def _add_joint(
    root: ElementTree.Element, model: mujoco.MjModel, j: int, ends: tuple[str, str], parent_from_child: Array
) -> None:
    """Add a hinge or a slide between two links."""
    name, kind = _name(model, mujoco.mjtObj.mjOBJ_JOINT, j, "joint"), _KINDS[int(model.jnt_type[j])]
    limited, column = bool(model.jnt_limited[j]), int(model.jnt_dofadr[j])
    element = ElementTree.SubElement(
        root, "joint", name=name, type="continuous" if kind == "revolute" and not limited else kind
    )
    _connect(element, ends, parent_from_child)
    ElementTree.SubElement(element, "axis", xyz=numbers(model.jnt_axis[j]))
    if limited:
        low, high = model.jnt_range[j]
        ElementTree.SubElement(element, "limit", lower=number(low), upper=number(high))
    losses = {"damping": model.dof_damping, "friction": model.dof_frictionloss, "armature": model.dof_armature}
    ElementTree.SubElement(element, "dynamics", {key: number(np.ravel(row[column])[0]) for key, row in losses.items()})


def _add_fixed(root: ElementTree.Element, parent: str, child: str, parent_from_child: Array) -> None:
    """Add a joint that fixes a link to its parent."""
    element = ElementTree.SubElement(root, "joint", name=f"{child}_fixed", type="fixed")
    _connect(element, (parent, child), parent_from_child)


def _connect(element: ElementTree.Element, ends: tuple[str, str], parent_from_child: Array) -> None:
    ElementTree.SubElement(element, "parent", link=ends[0])
    ElementTree.SubElement(element, "child", link=ends[1])
    element.append(origin_element(parent_from_child))


def _massless() -> ElementTree.Element:
    return inertial_element(Inertia(0.0, np.zeros(3), np.zeros((3, 3))))


def _inertial(model: mujoco.MjModel, k: int, link_from_body: Array) -> ElementTree.Element:
    """Mass properties of a body in its link's frame."""
    placed = link_from_body @ _pose(model.body_ipos[k], model.body_iquat[k])
    turn = placed[:3, :3]
    return inertial_element(Inertia(float(model.body_mass[k]), placed[:3, 3], turn @ np.diag(model.body_inertia[k]) @ turn.T))
