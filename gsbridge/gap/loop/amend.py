"""From findings about arm, object and camera to the simulation's model file.

What has a figure of its own there (`arm.delay`, `contact.table.friction`) changes it; all else joins the list `effects`, always
in the order arm, object, camera, so that it does not matter what was found first. What the simulation cannot play is refused by
name, with what to do instead, since a policy would otherwise learn in a world of which nobody knows what it holds.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.errors import InputError, StageError
from gsbridge.files import read_json, write_stage
from gsbridge.gap.diagnosis.amend import ordered, write_amended
from gsbridge.gap.formats.yaml_file import read_yaml
from gsbridge.sim.model import parse_model

_OF_JOINTS = {
    "gain_p": ("change", "stiffness", True),
    "gain_d": ("change", "damping", True),
    "viscous": ("coefficient", "viscous_friction", False),
    "armature": ("inertia", "armature", False),
}
"""Effect of a joint: its parameter, the list of `arm` that it changes, and whether it scales instead of being added."""

_OF_ARM = {"command_delay": ("time", "delay"), "gravcomp": ("change", "gravity_compensation")}
"""Effect of the whole arm: its parameter and the figure of `arm` that it is added to."""

_FIGURES = {"stiffness": "stiffness", "damping": "damping"}
_LOSSES = {"armature": "armature", "viscous": "viscous_friction"}

_OF_BODY = {
    "contact_friction": ("contact", "table", "friction"),
    "restitution": ("contact", "table", "restitution"),
    "rolling_friction": ("contact", "table", "rolling_friction"),
    "spinning_friction": ("contact", "table", "spinning_friction"),
    "gravity_scale": ("gravity",),
}
"""Effect of a thrown body: the figure that takes what the body's own figure becomes."""

_FROM_ZERO = ("linear_damping", "angular_damping", "steady_force", "table_height", "table_tilt")
"""Effects on figures that are zero in the simulation, whatever they were in the body's model."""

_DIGITS = 6


def amended_content(nominal: Mapping[str, Any], arm: Mapping[str, Any], source: str | Path) -> tuple[dict[str, Any], list[str]]:
    """Content of the simulation's model with everything that the arm's model says.

    Args:
        nominal: Content of the simulation's model.
        arm: Content of the arm's model (`gsbridge.gap.loop.arm`), calibrated and amended.
        source: The arm's model, for messages.

    Returns:
        The content, and sentences about figures of the calibration that it has no place for.

    Raises:
        InputError: The simulation cannot play an effect, or a figure is out of its range.
    """
    out = {key: dict(value) if isinstance(value, Mapping) else value for key, value in nominal.items()}
    figures = out["arm"]
    for ours, theirs in _FIGURES.items():
        figures[theirs] = list(arm["controller"][ours])
    for ours, theirs in _LOSSES.items():
        figures[theirs] = list(arm[ours])
    figures["gravity_compensation"] = float(arm["controller"]["gravity_compensation"])
    figures["delay"] = 0.0
    joints = list(arm["joints"])
    # The arm's model holds the effects on joints that the simulation had before, too.
    kept = [one.record() for one in parse_model(nominal, str(source)).effects_on("body", "camera")]
    added: list[Any] = []
    for effect in arm.get("effects") or []:
        name, joint, values = effect["name"], effect.get("joint", ""), effect["parameters"]
        if name in _OF_ARM:
            key, place = _OF_ARM[name]
            figures[place] += float(values[key])
        elif name in _OF_JOINTS:
            key, place, scales = _OF_JOINTS[name]
            k = joints.index(joint)
            figures[place][k] = figures[place][k] * (1.0 + values[key]) if scales else figures[place][k] + values[key]
        else:
            added.append(effect)
    for name, value in figures.items():
        figures[name] = [round(float(v), _DIGITS) for v in value] if isinstance(value, list) else round(float(value), _DIGITS)
    left = []
    dry = [float(value) for value in arm.get("coulomb") or []]
    if any(dry):
        listed = ", ".join(f"{value:.2g}" for value in dry)
        left.append(f"Coulomb friction of the joints ({listed} N m) was calibrated and is not simulated")
    out["effects"] = [*added, *kept]
    return ordered(out, source), left


def amend_simulation(
    nominal: str | Path, arm: str | Path, findings: str | Path, calibration: str | Path, model: str | Path, record: str | Path
) -> None:
    """Write the simulation's model with what was found about the arm.

    Args:
        nominal: The simulation's model as it was.
        arm: The arm's model, amended by the gap workflow.
        findings: What it found.
        calibration: Record of the calibration.
        model: The simulation's amended model.
        record: Record of the stage: figures before and after, and the evidence.

    Raises:
        StageError: Nothing was named, so that there is nothing to amend.
        InputError: A finding has no place in the simulation's model.
    """
    found = read_json(findings)
    _require_named("amend_simulation", found, findings)
    before, after = read_yaml(nominal, "model", "models/nominal.yaml"), read_yaml(arm, "model", "docs/gap.md")
    content, left = amended_content(before, after, arm)
    changed = {name: {"before": before["arm"][name], "after": value} for name, value in content["arm"].items()}
    changed = {name: pair for name, pair in changed.items() if pair["before"] != pair["after"]}
    named = {" ".join(filter(None, (e["name"], e.get("joint")))): dict(e["parameters"]) for e in found["amended"]}
    head = [
        "Amended by the gap workflow; made from models/nominal.yaml and not to be edited.",
        found["sentence"],
        *(f"record {role}: {digest}" for role, digest in found["records"].items()),
        f"seed {found['seed']}; details: {Path(record).name}",
    ]
    write_amended(model, content, head)
    write_stage(
        record,
        reasons=left,
        sentence=found["sentence"],
        named=named,
        intervals={
            " ".join(filter(None, (item["name"], item["joint"]))): {
                k: row["interval90"] for k, row in item["parameters"].items()
            }
            for item in found["effects"]
        },
        changed=changed,
        records=found["records"],
        calibrated_on=read_json(calibration)["records"],
        seed=found["seed"],
    )


def object_content(nominal: Mapping[str, Any], found: Mapping[str, Any], source: str | Path) -> dict[str, Any]:
    """Content of the simulation's model with everything that was found about a thrown object.

    Coefficients, gravity, losses, and height and tilt of the table become those that were found, whatever the model of the
    throws said before. Shares of mass and inertia, and how far the centre of mass is moved, are taken to hold of the asset.

    Args:
        nominal: Content of the simulation's model.
        found: Findings about the throws.
        source: The findings, for messages.

    Raises:
        InputError: An effect is not one on a body, the simulation cannot play it, or a figure is out of its range.
    """
    out = copy.deepcopy(dict(nominal))
    out["effects"] = list(out.get("effects") or [])
    rows = {item["name"]: item["parameters"] for item in found["effects"]}
    for named in found["amended"]:
        name = named["name"]
        if name not in BODY_EFFECTS:
            raise InputError(source, f"'{name}' is no effect on a thrown body", "Name a case of throws (docs/gap_objects.md)")
        if name in _OF_BODY:
            *sections, key = _OF_BODY[name]
            place = out
            for section in sections:
                place = place[section]
            (row,) = rows[name].values()
            place[key] = round(float(row["becomes"]), _DIGITS)
        elif name == "object_mass":
            out["object"]["mass"] = round(out["object"]["mass"] * (1.0 + named["parameters"]["share"]), _DIGITS)
        elif name in _FROM_ZERO:
            values = {key: float(row["becomes"]) for key, row in rows[name].items()}
            out["effects"] = [one for one in out["effects"] if one["name"] != name] + [{"name": name, "parameters": values}]
        else:
            out["effects"].append(dict(named))
    return ordered(out, source)


def amend_object(nominal: str | Path, findings: str | Path, model: str | Path) -> None:
    """Write the simulation's model with what was found about a thrown object.

    Args:
        nominal: The simulation's model as it was.
        findings: What was found.
        model: The amended model; the evidence stands in its head.

    Raises:
        StageError: Nothing was named, so that there is nothing to amend.
        InputError: The simulation cannot play a finding, or a file is damaged.
    """
    found = read_json(findings)
    _require_named("amend_object", found, findings)
    content = object_content(read_yaml(nominal, "model", "models/nominal.yaml"), found, findings)
    head = [
        f"Amended by the gap of throws; made from {Path(nominal).name} and not to be edited.",
        found["sentence"],
        *(f"throws {role}: {digest}" for role, digest in found["records"].items()),
        f"seed {found['seed']}",
    ]
    write_amended(model, content, head)


def _require_named(stage: str, found: Mapping[str, Any], findings: str | Path) -> None:
    """Refuse findings that name nothing.

    Raises:
        StageError: They name nothing.
    """
    if not found["amended"]:
        raise StageError(stage, f"the diagnosis named nothing ({found['verdict']}): {found['sentence']}", f"See {findings}")
