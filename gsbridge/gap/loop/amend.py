"""Transfer of findings about the arm and a thrown object to the simulation's model file.

An effect that corresponds to a figure of the model (`arm.delay`, `contact.table.friction`) changes that figure. All others are
added to the list `effects`, always in the order arm, object, camera, so that the order of the findings does not matter. An
effect that the simulation cannot play is refused by name, with advice; otherwise a policy would train without it unnoticed.
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
"""Effects of a joint: the parameter, the list in `arm` that it changes, and whether it scales the entry or is added to it."""

_OF_ARM = {"command_delay": ("time", "delay"), "gravcomp": ("change", "gravity_compensation")}
"""Effects of the whole arm: the parameter, and the figure in `arm` that it is added to."""

_FIGURES = {"stiffness": "stiffness", "damping": "damping"}
_LOSSES = {"armature": "armature", "viscous": "viscous_friction"}

_OF_BODY = {
    "contact_friction": ("contact", "table", "friction"),
    "restitution": ("contact", "table", "restitution"),
    "rolling_friction": ("contact", "table", "rolling_friction"),
    "spinning_friction": ("contact", "table", "spinning_friction"),
    "gravity_scale": ("gravity",),
}
"""Effects of a thrown body: the figure of the simulation that is set to the new value of the body's own figure."""

_FROM_ZERO = ("linear_damping", "angular_damping", "steady_force", "table_height", "table_tilt")
"""Effects on figures that are zero in the simulation, so that the whole new value, not the change, becomes the effect."""

_DIGITS = 6


def amended_content(nominal: Mapping[str, Any], arm: Mapping[str, Any], source: str | Path) -> tuple[dict[str, Any], list[str]]:
    """Return the content of the simulation's model with the figures and effects of the arm's model.

    Args:
        nominal: Content of the simulation's model.
        arm: Content of the arm's model (`gsbridge.gap.loop.arm`), calibrated and amended.
        source: File of the arm's model, for messages.

    Returns:
        The content, and sentences about calibrated figures that the simulation's model has no place for.

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
    # Keep only effects on bodies and cameras; the arm's model already contains the simulation's earlier effects on joints.
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
    """Write the simulation's model with the findings about the arm.

    Args:
        nominal: File of the simulation's original model.
        arm: File of the arm's model, amended by the gap workflow.
        findings: File of the workflow's findings (`findings.json`).
        calibration: Record of the calibration.
        model: File to write the simulation's amended model to.
        record: File to write the stage's record to: figures before and after, and the evidence.

    Raises:
        StageError: Nothing was named, so that there is nothing to amend.
        InputError: The simulation cannot play an effect, or a figure is out of its range.
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
    """Return the content of the simulation's model with the findings about a thrown object.

    Contact coefficients, gravity, losses, and height and tilt of the table are set to the values that were found, whatever the
    model of the throws said before. Relative changes of mass and inertia, and the shift of the centre of mass, are applied to
    the asset.

    Args:
        nominal: Content of the simulation's model.
        found: Content of the findings about the throws.
        source: File of the findings, for messages.

    Raises:
        InputError: An effect is not an effect on a body, the simulation cannot play it, or a figure is out of its range.
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
    """Write the simulation's model with the findings about a thrown object.

    Args:
        nominal: File of the simulation's original model.
        findings: File of the findings (`findings.json`).
        model: File to write the amended model to; comments at its top state the evidence.

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
        StageError: The findings name nothing.
    """
    if not found["amended"]:
        raise StageError(stage, f"the diagnosis named nothing ({found['verdict']}): {found['sentence']}", f"See {findings}")
