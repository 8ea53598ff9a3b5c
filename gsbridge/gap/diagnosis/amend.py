"""The amended model: the user's model file with the named effects and the evidence for them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from gsbridge.files import atomic_file
from gsbridge.gap.formats.yaml_file import read_yaml


def amend_model(model: str | Path, findings: Mapping[str, Any], out: str | Path) -> None:
    """Write a copy of a model file with what `findings` names; without a name it is a plain copy.

    Args:
        model: The model file that was diagnosed.
        findings: As written to `findings.json`.
        out: The amended model; a URDF's path is made relative to it.

    Raises:
        InputError: The model cannot be read.
    """
    model, out = Path(model), Path(out)
    content = read_yaml(model, "model", "docs/gap.md")
    if "urdf" in content:
        content["urdf"] = os.path.relpath((model.parent / content["urdf"]).resolve(), out.resolve().parent)
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
