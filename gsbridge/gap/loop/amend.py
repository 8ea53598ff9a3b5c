"""From findings about the simulated arm to the simulation's model file: `arm.delay`, `arm.stiffness` and so on.

The file has one place for each figure. What a finding says and the file cannot express is refused by name, since a policy would
otherwise learn in a world of which nobody knows what it holds.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from gsbridge.errors import InputError, StageError
from gsbridge.files import atomic_file, read_json, write_stage
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

_NAMED = "named"
"""Verdict of an effect that must have a place in the simulation; others of an account are left out, and that is told."""

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
        InputError: An effect has no place in the simulation's model, or a figure is out of its range.
    """
    out = {key: dict(value) if isinstance(value, Mapping) else value for key, value in nominal.items()}
    figures = out["arm"]
    for ours, theirs in _FIGURES.items():
        figures[theirs] = list(arm["controller"][ours])
    for ours, theirs in _LOSSES.items():
        figures[theirs] = list(arm[ours])
    figures["gravity_compensation"] = float(arm["controller"]["gravity_compensation"])
    figures["delay"] = 0.0
    joints, left = list(arm["joints"]), list[str]()
    verdicts = {label: verdict for item in arm.get("evidence") or [] for label, verdict in (item.get("verdicts") or {}).items()}
    for effect in arm.get("effects") or []:
        name, joint, values = effect["name"], effect.get("joint", ""), effect["parameters"]
        if name in _OF_ARM:
            key, place = _OF_ARM[name]
            figures[place] += float(values[key])
        elif name in _OF_JOINTS:
            key, place, scales = _OF_JOINTS[name]
            k = joints.index(joint)
            figures[place][k] = figures[place][k] * (1.0 + values[key]) if scales else figures[place][k] + values[key]
        elif verdicts.get(":".join(filter(None, (name, joint))), _NAMED) != _NAMED:
            left.append(f"'{name}'{f' of joint {joint!r}' if joint else ''} is likely, not proven, and not simulated")
        else:
            known = ", ".join(sorted({*_OF_ARM, *_OF_JOINTS}))
            where = f" of joint '{joint}'" if joint else ""
            raise InputError(
                source,
                f"the simulation's model has no place for '{name}'{where}",
                f"It can take: {known}; add others to gsbridge.sim",
            )
    for name, value in figures.items():
        figures[name] = [round(float(v), _DIGITS) for v in value] if isinstance(value, list) else round(float(value), _DIGITS)
    dry = [float(value) for value in arm.get("coulomb") or []]
    if any(dry):
        listed = ", ".join(f"{value:.2g}" for value in dry)
        left.append(f"Coulomb friction of the joints ({listed} N m) was calibrated and is not simulated")
    parse_model(out, str(source))
    return out, left


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
    if not found["amended"]:
        raise StageError(
            "amend_simulation", f"the diagnosis named nothing ({found['verdict']}): {found['sentence']}", f"See {findings}"
        )
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
    text = "".join(f"# {line}\n" for line in head) + yaml.safe_dump(
        content, sort_keys=False, default_flow_style=None, width=128
    )
    with atomic_file(model) as temporary:
        temporary.write_text(text, encoding="utf-8")
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
