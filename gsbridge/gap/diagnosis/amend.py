"""Amended models: the user's model file with the named effects and their evidence, and the model of the simulation."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from gsbridge.files import atomic_file
from gsbridge.gap.formats.yaml_file import read_yaml
from gsbridge.sim.model import parse_model


def amend_model(model: str | Path, findings: Mapping[str, Any], out: str | Path) -> None:
    """Write a copy of a model file with the effects that `findings` names, if any, and the evidence.

    Args:
        model: The model file that was diagnosed.
        findings: Content of `findings.json`.
        out: The amended model; the path of a URDF or MJCF is made relative to it.

    Raises:
        InputError: The model cannot be read.
    """
    model, out = Path(model), Path(out)
    content = read_yaml(model, "model", "docs/gap.md")
    for key in content.keys() & {"urdf", "mjcf"}:
        content[key] = os.path.relpath((model.parent / content[key]).resolve(), out.resolve().parent)
    content["effects"] = [*(content.get("effects") or []), *(dict(effect) for effect in findings["amended"])]
    evidence = {
        "sentence": findings["sentence"],
        "verdict": findings["verdict"],
        "verify": {key: findings["verify"][key] for key in ("before", "after", "closure", "unit")}
        if findings["verify"]
        else None,
        "intervals": {
            " ".join(filter(None, (item["name"], item["joint"]))): {
                k: row["interval90"] for k, row in item["parameters"].items()
            }
            for item in ((findings.get("account") or {}).get("entries") or findings["effects"])
        }
        if findings["amended"]
        else {},
        "verdicts": {item["label"]: item["verdict"] for item in (findings.get("account") or {"entries": []})["entries"]},
        "rivals": [{"effects": row["effects"], "behind": row["behind"]} for row in findings["rivals"][1:4]],
        "records": dict(findings["records"]),
        "seed": findings["seed"],
    }
    content["evidence"] = [*(content.get("evidence") or []), evidence]
    with atomic_file(out) as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")


def ordered(content: dict[str, Any], source: str | Path) -> dict[str, Any]:
    """Return the content of a simulation model with its effects in the order arm, object, camera.

    Args:
        content: Content of the model's file.
        source: Where the content comes from, for error messages.

    Raises:
        InputError: The simulation cannot play an effect, or a figure is out of its range.
    """
    model = parse_model(content, str(source))
    effects = [*model.effects_on("joint", "mechanism"), *model.effects_on("body"), *model.effects_on("camera")]
    return {**content, "effects": [effect.record() for effect in effects]}


def write_amended(out: str | Path, content: Mapping[str, Any], head: Sequence[str]) -> None:
    """Write an amended model with comment lines at its top that say what it is based on.

    Args:
        out: The file to write.
        content: Content of the model.
        head: The comment lines, without `#`.
    """
    text = "".join(f"# {line}\n" for line in head)
    text += yaml.safe_dump(dict(content), sort_keys=False, default_flow_style=None, width=128)
    with atomic_file(out) as temporary:
        temporary.write_text(text, encoding="utf-8")
