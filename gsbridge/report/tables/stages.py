"""The stages before the splats at a glance: one line per scene, from the records that the stages left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.files import read_json
from gsbridge.report.tables.formats import Table
from gsbridge.report.tables.paper import scene_order
from gsbridge.report.tables.result_paths import scene_of

COLUMNS = (
    "scene",
    "keyframes",
    "registered",
    "reprojection px",
    "scale from",
    "scale ± %",
    "plane mm",
    "mask area %",
    "status",
)
DASH = "–"
NOTE = (
    "Registered: photos whose camera was found. Reprojection: mean distance from where a point is seen to where it should be. "
    "Scale: what gives metres, and its standard error. Plane: how far measured points of the table lie from its plane. "
    "Mask area: the object's mean share of a photo."
)

Records = dict[str, dict[str, dict[str, Any]]]


def read_records(paths: Sequence[str | Path]) -> Records:
    """Stage records by scene and stage: {scene: {stage: record}}; the splats stage carries its binding in brackets.

    Args:
        paths: Records below `scenes/{scene}/`.

    Raises:
        InputError: A record is damaged.
    """
    out: Records = {}
    for path in map(Path, paths):
        record = read_json(path)
        stage = f"{path.stem} ({record['binding']})" if "binding" in record else path.stem
        out.setdefault(scene_of(path), {})[stage] = record
    return {scene: out[scene] for scene in sorted(out, key=scene_order)}


def degraded_reasons(records: Records) -> dict[str, list[str]]:
    """Reasons of stages that are no clean pass: {scene: ["stage: reason", …]}."""
    out = {
        scene: [
            f"{stage}: {reason}"
            for stage, record in stages.items()
            if record.get("status") == "degraded"
            for reason in record.get("reasons", [])
        ]
        for scene, stages in records.items()
    }
    return {scene: reasons for scene, reasons in out.items() if reasons}


def stages_table(records: Records) -> Table | None:
    """What each stage says of each scene; None without records."""
    if not records:
        return None
    rows, status = [], []
    for scene, stages in records.items():
        capture, sfm = stages.get("keyframes", {}), stages.get("sfm", {})
        align, masks = stages.get("align", {}), stages.get("masks", {})
        degraded = any(record.get("status") == "degraded" for record in stages.values())
        status.append("degraded" if degraded else "pass")
        area = masks.get("area", {}).get("mean")
        rows.append(
            (
                scene,
                str(len(capture["frames"])) if "frames" in capture else DASH,
                f"{sfm['registered']} of {sfm['total']}" if "registered" in sfm else DASH,
                _digits(sfm.get("reprojection_px"), 2),
                str(align.get("scale_source") or DASH),
                _relative_scale_error(align),
                _digits(align.get("residual_mm"), 2),
                _digits(None if area is None else 100 * area, 1),
                status[-1],
            )
        )
    return Table("From photos to a table frame", COLUMNS, tuple(rows), (NOTE,), status=tuple(status))


def _digits(value: float | None, digits: int) -> str:
    """Format a number with `digits` decimals; None becomes a dash."""
    return DASH if value is None else f"{value:.{digits}f}"


def _relative_scale_error(align: Mapping[str, Any]) -> str:
    """Format the standard error of the scale in percent of the scale; a dash where it is not known."""
    scale, error = align.get("scale"), align.get("scale_se")
    return DASH if not scale or error is None else f"{100 * error / scale:.3f}"
