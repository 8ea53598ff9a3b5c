"""A user's case: a YAML file that names a model and records."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import read_names
from gsbridge.errors import InputError
from gsbridge.gap.diagnosis.results import ROLES
from gsbridge.gap.formats.clock import PAUSE, steadied, unbroken
from gsbridge.gap.formats.columns import refuse_shared, refuse_unmatched
from gsbridge.gap.formats.following import check_following, check_velocity, differenced
from gsbridge.gap.formats.kinds import shared_kinds, without
from gsbridge.gap.formats.logs import read_log
from gsbridge.gap.formats.quantum import shared_steps
from gsbridge.gap.formats.records import (
    AXES,
    COMMANDS,
    MEASURED,
    SHORTEST,
    TOOL,
    Layout,
    Record,
    check_degrees,
    doubtful_degrees,
)
from gsbridge.gap.formats.shared import shared_motion
from gsbridge.gap.formats.yaml_file import read_case_file, stated_number
from gsbridge.gap.joints.mechanism.description import read_mechanism_description
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel, read_mechanism_model
from gsbridge.gap.joints.repeats import refuse_repeats, scatter_of
from gsbridge.geometry import Array
from gsbridge.reading import refusing

_KEYS = ("model", "records", "repeats", "columns", "units", "torque_per_ampere", "noise", "tolerance", "effects")

_LIGHT = 0.02
"""Share of a mechanism's mass up to which a part that wrongly stands still in the model needs no warning."""

_HELD = 0.05
"""Distance from zero, rad or m, up to which a joint counts as held there."""

_LARGEST = {"position": 1.0, "velocity": 100.0, "effort": 1e4, TOOL: 1.0}
"""Largest noise and tolerance that a case may state, SI units, by kind of column: with more, nothing would count as a gap."""

_FINEST = 1e-12
"""Smallest noise that a case may state, SI units. Sensors are many orders coarser, and residuals are divided by the noise."""

_LARGEST_GAIN = 1e6
"""Largest size of a torque per ampere, N m/A or N/A; its inverse is the smallest."""

_SPARSE = 100.0
"""Samples per second below which a warning is given: fast effects happen between the samples."""


@dataclass(frozen=True)
class JointCase:
    """A checked case about a mechanism.

    Args:
        model: The model file.
        system: Content of the model's file.
        records: Records by role.
        names: Effects that may be the cause; None for all.
        reasons: Reasons why the result is degraded, in words.
    """

    model: Path
    system: MechanismModel
    records: Mapping[str, Record]
    names: tuple[str, ...] | None
    reasons: tuple[str, ...]


def read_joint_case(path: str | Path) -> JointCase:
    """Read and check a case.

    Raises:
        InputError: The file, its model or a record cannot be used.
    """
    path = Path(path)
    with refusing(path, "the case cannot be used", "Correct it after docs/gap.md"):
        return _joint_case(path)


def _joint_case(path: Path) -> JointCase:
    content = read_case_file(path, "docs/gap.md", "records", _KEYS)
    if not isinstance(content["model"], str):
        raise InputError(path, "'model' is no file name", "Write 'model: arm.yaml'; see docs/gap.md")
    model = path.parent / content["model"]
    system = read_mechanism_model(model)
    held = _held(system)
    _check_sections(content, path, (*system.joints, *held))
    refuse_repeats(content, system.controller, path)
    gains = _gains(content.get("torque_per_ampere"), system.joints, path)
    reasons = []
    if gains:
        reasons.append("efforts come from currents by a stated gain, which scales every torque found")
    layout = Layout(
        system.joints,
        system.controller.mode == "torque",
        dict(content.get("columns") or {}),
        dict(content.get("units") or {}),
        gains,
        system.sliding,
        held,
    )
    names = read_names(content.get("effects"), path, JOINT_EFFECTS, BODY_EFFECTS)
    records, scattered = dict[str, Record](), dict[str, float]()
    for role, file in content["records"].items():
        if role not in ROLES:
            raise InputError(path, f"'{role}' is no role of a record", f"The roles are {', '.join(ROLES)}")
        if not isinstance(file, str):
            raise InputError(path, f"records.{role} is {file!r}, which is no file name", f"Write '{role}: log.csv'")
        records[role], broken, scatters = _read(path.parent / file, layout, system, content)
        scattered |= {} if scatters is None else {role: scatters}
        reasons += [f"of the record '{role}' {broken}"] if broken else []
        if system.controller.closed_loop and not np.ptp(records[role].commands["command"], axis=0).any():
            if role == "fit":
                raise InputError(
                    path.parent / file,
                    "no joint is commanded to move",
                    "Log motion over the range you care about, with reversals",
                )
            reasons.append(f"no joint is commanded to move in the record '{role}', which tells little then")
    refuse_unmatched(content.get("columns") or {}, [record.unmatched for record in records.values()], path)
    if scattered:
        rates = ", ".join(f"{1.0 / records[role].period:.3g} Hz in '{role}'" for role in scattered)
        reasons.append(
            f"time stamps scatter by {1e3 * max(scattered.values()):.2g} ms about a steady clock ({rates}), by which the "
            "motion is much smoother: its times were taken"
        )
    records, missing = shared_kinds(records, () if system.controller.closed_loop else ("effort",), path)
    reasons += missing
    quanta = shared_steps([record.measured for record in records.values()], [record.quantum for record in records.values()])
    records = {role: replace(records[role], quantum=steps) for role, steps in zip(records, quanta, strict=True)}
    reasons += shared_motion(records)
    if all(differenced(record) for record in records.values()):
        records = {role: without(record, "velocity") for role, record in records.items()}
        reasons.append("the speeds are differences of the logged positions, which say the same: they were left out")
    scatter: dict[str, Array] = {}
    for role, files in (content.get("repeats") or {}).items():
        if role not in records:
            raise InputError(path, f"there are repeats of '{role}', but no such record", f"Name it: {', '.join(records)}")
        for file in files if isinstance(files, list) else [files]:
            again = _read(path.parent / str(file), layout, system, content)[0]
            for kind, values in scatter_of(records[role], again, path.parent / file).items():
                scatter[kind] = np.maximum(scatter.get(kind, 0.0), values)
    for role, record in records.items():
        wider = {kind: np.maximum(record.tolerance.get(kind, 0.0), values) for kind, values in scatter.items()}
        records[role] = replace(record, tolerance={**record.tolerance, **wider})
    records, split = split_records(records, path)
    if "effort" not in records["fit"].measured and system.controller.closed_loop:
        reasons.append("no efforts are logged: latency and filters, viscous friction and damping are hard to tell apart")
    if "position" not in records["fit"].measured:
        reasons.append("no joint positions are logged: what moves the tool alike cannot be told apart")
    slowest = 1.0 / max(record.period for record in records.values())
    if slowest < 0.99 * _SPARSE:
        reasons.append(f"only {slowest:.3g} samples per second are logged: what is faster than a few of them cannot be told")
    reasons += doubtful_degrees(records["fit"], system.limits)
    for joint in held:
        far, unit = max(record.held.get(joint, 0.0) for record in records.values()), "m" if held[joint] else "rad"
        if far > _HELD:
            reasons.append(
                f"joint '{joint}' is logged up to {far:.2g} {unit} from zero, where the model holds it, for 'joints' lacks it"
            )
    reasons += _still(system)
    return JointCase(model, system, records, names, (*reasons, *split))


def _still(system: MechanismModel) -> list[str]:
    """Warn, in words, of heavy parts that follow a joint in the URDF but stand still in the model."""
    description = read_mechanism_description(system.urdf)
    carried, moving = {description.base: ""}, set(system.joints)
    masses = dict.fromkeys((joint.name for joint in description.joints), 0.0)
    while more := {joint.name for joint in description.joints if joint.follows in moving} - moving:
        moving |= more
    # The joints are listed parents first, so that each link is counted to the last moving joint above it.
    for joint in description.joints:
        carried[joint.child] = joint.name if joint.name in moving else carried[joint.parent]
        if carried[joint.child] and joint.child in description.inertials:
            masses[carried[joint.child]] += description.inertials[joint.child].mass
    whole = sum(element.mass for element in description.inertials.values())
    return [
        f"joint '{joint.name}' follows '{joint.follows}' in the URDF and stands still in the model, with"
        f" {masses[joint.name]:.2g} kg: if that matters, name it in 'joints' and log it, too"
        for joint in description.joints
        if joint.name in moving and joint.name not in system.joints and masses[joint.name] > _LIGHT * whole
    ]


def _held(system: MechanismModel) -> dict[str, bool]:
    """Find the movable joints that the model does not name and so holds at zero; each maps to whether it slides."""
    joints = read_mechanism_description(system.urdf).joints
    return {
        joint.name: joint.kind == "prismatic"
        for joint in joints
        if joint.kind in ("revolute", "continuous", "prismatic") and joint.name not in system.joints and joint.follows is None
    }


def _check_sections(content: Mapping[str, Any], path: Path, joints: Collection[str]) -> None:
    """Check the sections `columns`, `units`, `noise` and `tolerance` of a case.

    Args:
        content: Content of the case.
        path: File of the case, for messages.
        joints: All movable joints of the mechanism.

    Raises:
        InputError: A section is no mapping, a key is no column or kind of column, or a column's name or unit is no text.
    """
    columns = {
        "time",
        *(f"{TOOL}.{axis}" for axis in AXES),
        *(f"{kind}.{j}" for kind in (*COMMANDS, *MEASURED) for j in joints),
    }
    measured = (*MEASURED, TOOL)
    kinds = ("time", *COMMANDS, *measured)
    for key, known, example, listed in (
        ("columns", columns, f"position.{next(iter(joints))}: YOURS", f"Ours are {', '.join(kinds)}, of {', '.join(joints)}"),
        ("units", {*columns, *kinds}, "position: deg", f"Use {', '.join(kinds)}"),
        ("noise", measured, "position: 2.0e-4", f"Use {', '.join(measured)}"),
        ("tolerance", measured, "position: 5.0e-4", f"Use {', '.join(measured)}"),
    ):
        section = content.get(key)
        if section is None:
            continue
        if not isinstance(section, Mapping):
            raise InputError(path, f"'{key}' is {section!r}", f"Write '{key}: {{{example}}}'")
        for name, value in section.items():
            if name not in known:
                raise InputError(
                    path, f"'{name}' under '{key}' is no name of ours for a column", f"Write '{key}: {{{example}}}'. {listed}"
                )  # fmt: skip
            if key in ("columns", "units") and not isinstance(value, str):
                raise InputError(path, f"{key}.{name} is {value!r}, which is no text", "Put it in quotes")
    refuse_shared(content.get("columns") or {}, path)


def _read(file: Path, layout: Layout, system: MechanismModel, content: Mapping[str, Any]) -> tuple[Record, str, float | None]:
    """Read a record; also return what was left out, in words, and the scatter of its stamps about a steady clock, s."""
    record = _check(read_log(file, layout), system, file, content)
    # Without a controller, nothing is commanded during a break: only one that is no pause between two runs ends the record.
    record, broken = unbroken(record, file, PAUSE if system.controller.mode == "free" else 0.0)
    record, scatters = steadied(record)
    # By their times as they count: a logger that stamps late would make speeds look wrong.
    check_velocity(record, file)
    return record, "; ".join(part for part in (record.cut, broken) if part), scatters


def _gains(stated: Any, joints: tuple[str, ...], source: Path) -> dict[str, float]:
    """Read the torque per ampere of each joint that has one; a negative gain turns the sign of the current.

    A case states one number for all joints, a list in the joints' order, or a mapping by joint.

    Raises:
        InputError: The value is none of these, a joint is unknown, or a gain is no number or far from that of any motor.
    """
    if stated is None:
        return {}
    gains = stated if isinstance(stated, Mapping) else dict.fromkeys(joints, stated)
    if isinstance(stated, list):
        gains = dict(zip(joints, stated, strict=False))
    if set(gains) - set(joints) or (isinstance(stated, list) and len(stated) != len(joints)):
        names = ", ".join(joints)
        raise InputError(
            source, f"'torque_per_ampere' is {stated!r}", f"Give one number for all, a list, or one by joint, of {names}"
        )
    high, key, unit = _LARGEST_GAIN, "torque_per_ampere", "N m/A (N/A where a joint slides)"
    out = {str(joint): stated_number(gain, -high, high, key, unit, source) for joint, gain in gains.items()}
    if any(abs(gain) < 1.0 / high for gain in out.values()):
        raise InputError(source, f"'{key}' is {stated!r}", f"Give {1.0 / high:g} to {high:g} {unit}, or leave it out")
    return out


def _check(record: Record, system: MechanismModel, source: Path, content: Mapping[str, Any]) -> Record:
    """Check that a record fits its mechanism, and add the noise and the tolerance that the case states.

    Raises:
        InputError: Commands, positions or the tool's link are missing, angles are degrees, or a stated size cannot be used.
    """
    if system.controller.mode != "free" and "command" not in record.commands:
        record_needs = "torques" if system.controller.mode == "torque" else "commanded positions"
        raise InputError(
            source,
            f"there are no columns 'command.{system.joints[0]}' with {record_needs}",
            f"Mode {system.controller.mode} needs them",
        )
    if TOOL in record.measured and not system.tool and "position" in record.measured:
        # The log holds more than the model needs.
        record = without(record, TOOL)
    if TOOL in record.measured and not system.tool:
        raise InputError(source, "it has columns 'tool.x', but the model does not say which link that is", "Add 'tool: LINK'")
    if "position" not in record.measured and not system.controller.closed_loop:
        raise InputError(
            source, f"without joint positions nobody knows where mode {system.controller.mode} begins", "Log positions, too"
        )
    check_degrees(record, source, system.limits)
    if system.controller.closed_loop:
        check_following(record, source)
    stated = {
        key: {
            kind: _per_column(f"{key}.{kind}", value, record.measured[kind].shape[1], low, source)
            for kind, value in (content.get(key) or {}).items()
            if kind in record.measured
        }
        for key, low in (("noise", _FINEST), ("tolerance", 0.0))
    }
    return replace(record, sigma=stated["noise"], tolerance=stated["tolerance"])


def _per_column(key: str, value: float | list[float], count: int, low: float, source: Path) -> Array:
    """Spread a stated noise or tolerance over the columns of its kind. [N].

    Args:
        key: `noise.KIND` or `tolerance.KIND`.
        value: Stated value, SI units: one number for all columns, or a list.
        count: Number of columns.
        low: Smallest size that is allowed.
        source: File, for messages.

    Raises:
        InputError: A number lies outside `low` to the largest size for the kind, or the list has another length.
    """
    values = value if isinstance(value, list) else [value] * count
    if len(values) != count:
        raise InputError(source, f"{key} is {value!r}", f"Give one positive number, or one for each of {count} columns")
    high = _LARGEST[key.partition(".")[2]]
    return np.array([stated_number(one, low, high, key, "in SI units", source) for one in values])


def split_records(records: Mapping[str, Record], source: str | Path) -> tuple[dict[str, Record], tuple[str, ...]]:
    """Cut a record by time where fewer than three were given; also return a warning about that, in words.

    Raises:
        InputError: A part would be too short.
    """
    missing = [role for role in ROLES if role not in records]
    if not missing:
        return dict(records), ()
    if "fit" not in records:
        raise InputError(source, "there is no record 'fit'", "Name the longest one fit")
    out = {role: record for role, record in records.items() if role in ROLES}
    whole = "select" if "select" in records else "fit"
    parts = ROLES[ROLES.index(whole) :] if whole == "select" else ("fit", *missing)
    record = records[whole]
    edges = np.linspace(0, len(record.time), len(parts) + 1).astype(int)
    if record.duration / len(parts) < SHORTEST:
        raise InputError(
            source, f"the record '{whole}' lasts {record.duration:.3g} s, too short to be cut into {len(parts)}",
            f"Log three records of different motion, or at least {SHORTEST * len(parts):g} s",
        )  # fmt: skip
    for role, first, last in zip(parts, edges[:-1], edges[1:], strict=True):
        out[role] = record.part(int(first), int(last), role)
    return out, (f"the record '{whole}' was cut into {', '.join(parts[:-1])} and {parts[-1]}, which share one kind of motion",)
