"""Rows of the rendering table: one per scene, binding, seed, surface, split and region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.configuration.bindings import BINDINGS
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.report.tables.paper import paper_values, scene_order
from gsbridge.report.tables.result_paths import is_main_run, scene_of
from gsbridge.report.tables.rows import Row, number, write_rows
from gsbridge.report.tables.stages import degraded_reasons, read_records

Ceilings = dict[tuple[str, str], float]


def read_ceilings(film_json: str | Path) -> Ceilings:
    """Read the noise ceilings of a film's photos: the PSNR that a perfect model would reach, dB.

    Held-out photos are the ones with the most samples per pixel, training photos those with the fewest.

    Args:
        film_json: Record of a film.

    Returns:
        {(split, region): ceiling}; entries that the film's record lacks are missing.

    Raises:
        InputError: The record is damaged.
    """
    film = read_json(film_json)
    try:
        samples = [int(frame["spp"]) for frame in film["frames"]]
        chosen = {"held_out": str(max(samples)), "train": str(min(samples))}
        full = film.get("ceiling_db") or {}
        # A background's masked region is the table, which fills its photos, so the ceiling of the whole frame counts there.
        masked = film.get("ceiling_masked_db") or (full if film.get("kind") == "background" else {})
        regions = {"masked": masked, "full": full}
        return {
            (split, region): float(ceilings[count])
            for split, count in chosen.items()
            for region, ceilings in regions.items()
            if ceilings.get(count) is not None
        }
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(film_json, f"the film's record is damaged ({error!r})", "Film the scene again") from error


COLUMNS = (
    "scene",
    "kind",
    "binding",
    "split",
    "region",
    "views",
    "psnr",
    "ssim",
    "lpips",
    "alpha_iou",
    "splats",
    "seed",
    "paper_psnr",
    "paper_ssim",
    "paper_lpips",
    "status",
    "origin",
    "surface",
    "main",
    "reasons",
    "lpips_reason",
    "ceiling_db",
)
"""The columns that every reader may count on come first; `origin` and the columns after it explain them."""

SPLITS = ("held_out", "train")
REGIONS = ("masked", "full")
SURFACES = ("visual", "hull")
NO_LPIPS = "no LPIPS weights file is configured"


def rendering_rows(
    splats_json: Sequence[str | Path],
    scenes: Mapping[str, Mapping[str, str]],
    films: Mapping[str, str | Path] | None = None,
    records: Sequence[str | Path] = (),
) -> list[dict[str, Any]]:
    """Make the rows from the records of trained splats.

    Args:
        splats_json: Records `splats.json` below `scenes/{scene}/splats/` (main runs) or `scenes/{scene}/comparison/`.
        scenes: For each scene its `kind` (`object` or `background`) and `origin` (`mirror` or `real`).
        films: `film.json` of mirrored scenes, for the noise ceiling beside each score.
        records: Records of the earlier stages; a scene that one of them marks as degraded stays degraded.

    Returns:
        Rows in a fixed order, whatever the order of the records.

    Raises:
        InputError: A record is damaged or belongs to an unknown scene.
    """
    rows = []
    before = degraded_reasons(read_records(records))
    ceilings = {scene: read_ceilings(path) for scene, path in (films or {}).items()}
    for path in splats_json:
        scene = scene_of(path)
        if scene not in scenes:
            raise InputError(path, f"the scene {scene!r} is not configured", "Add it to config.yaml or leave the record out")
        found = _record_rows(path, scene, scenes[scene]["kind"], scenes[scene]["origin"])
        if scene in before:
            found = [
                {**row, "status": "degraded", "reasons": "; ".join(filter(None, [*before[scene], row["reasons"]]))}
                for row in found
            ]
        rows += [{**row, "ceiling_db": ceilings.get(scene, {}).get((row["split"], row["region"]))} for row in found]
    return sorted(rows, key=_order)


def _record_rows(path: str | Path, scene: str, kind: str, origin: str) -> list[dict[str, Any]]:
    """Rows of one record."""
    record = read_json(path)
    try:
        binding = record["binding"]
        paper = paper_values(scene, binding, origin)
        common = {
            "scene": scene,
            "kind": kind,
            "binding": binding,
            "splats": int(record["splats"]),
            "seed": record["seed"],
            "paper_psnr": paper and f"{paper.psnr:.2f}",
            "paper_ssim": paper and f"{paper.ssim:.3f}",
            "paper_lpips": paper and f"{paper.lpips:.3f}",
            "status": record["status"],
            "origin": origin,
            "surface": record.get("surface") or "visual",
            "main": is_main_run(path),
            "reasons": "; ".join(record["reasons"]),
        }
        return [
            {
                **common,
                "split": split,
                "region": region,
                **_metrics(record["metrics"][split][region], record.get("lpips_reason")),
            }
            for split in SPLITS
            for region in REGIONS
            if region in record["metrics"].get(split, {})
        ]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(path, f"the record is damaged ({error!r})", "Delete it and run the splats stage again") from error


def _metrics(figures: Mapping[str, Any], lpips_reason: str | None) -> dict[str, Any]:
    """Metric columns of one split and region."""
    lpips = figures.get("lpips")
    return {
        "views": int(figures["views"]),
        "psnr": None if figures["psnr"] is None else float(figures["psnr"]),
        "ssim": None if figures["ssim"] is None else float(figures["ssim"]),
        "lpips": None if lpips is None else float(lpips),
        "alpha_iou": None if figures.get("alpha_iou") is None else float(figures["alpha_iou"]),
        "lpips_reason": (lpips_reason or NO_LPIPS) if lpips is None else "",
    }


def _order(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """Mirror before real, objects before backgrounds, the paper's order of scenes, then main runs before comparisons."""
    return (
        row["origin"] != "mirror",
        row["kind"] != "object",
        scene_order(row["scene"]),
        not row["main"],
        SURFACES.index(row["surface"]) if row["surface"] in SURFACES else len(SURFACES),
        BINDINGS.index(row["binding"]) if row["binding"] in BINDINGS else len(BINDINGS),
        int(row["seed"] or 0),
        SPLITS.index(row["split"]),
        REGIONS.index(row["region"]),
    )


def write_rendering_rows(
    splats_json: Sequence[str | Path],
    out_csv: str | Path,
    *,
    scenes: Mapping[str, Mapping[str, str]],
    films: Mapping[str, str | Path] | None = None,
    records: Sequence[str | Path] = (),
) -> None:
    """Write `rows/rendering.csv`.

    Args:
        splats_json: Records of trained splats, as `rendering_rows` takes them.
        out_csv: File to write.
        scenes: Kind and origin of each scene, as `rendering_rows` takes them.
        films: `film.json` of mirrored scenes, for the noise ceiling beside each score.
        records: Records of the earlier stages; a scene that one of them marks as degraded stays degraded.
    """
    write_rows(out_csv, COLUMNS, rendering_rows(splats_json, scenes, films, records))


def values(rows: Sequence[Row], column: str, **fixed: str) -> dict[tuple[str, str], float]:
    """One column as {(scene, seed): value}, of the rows whose cells equal `fixed`.

    A run that is both among the main runs and among the comparisons counts once, as the main run.

    Args:
        rows: Rows of `rendering.csv`.
        column: Name of the column.
        **fixed: Text that a row must hold, by column.
    """
    out: dict[tuple[str, str], float] = {}
    for row in sorted(rows, key=lambda row: row["main"] == "true"):
        value = number(row[column])
        if value is not None and all(row[name] == wanted for name, wanted in fixed.items()):
            out[row["scene"], row["seed"]] = value
    return out


def mean_by_scene(pairs: Mapping[tuple[str, str], float]) -> dict[str, float]:
    """Mean over the seeds of each scene."""
    scenes: dict[str, list[float]] = {}
    for (scene, _), value in pairs.items():
        scenes.setdefault(scene, []).append(value)
    return {scene: sum(found) / len(found) for scene, found in sorted(scenes.items(), key=lambda item: scene_order(item[0]))}


def differences(
    rows: Sequence[Row], better: str, other: str, column: str = "psnr", **fixed: str
) -> dict[str, dict[str, float]]:
    """Paired differences `better - other` of two bindings, on the seeds that both have.

    Args:
        rows: Rows of `rendering.csv`.
        better, other: Bindings.
        column: Column to subtract.
        **fixed: Cells that the rows must have, for example `split="held_out"`.

    Returns:
        {scene: {seed: difference}}.
    """
    left = values(rows, column, binding=better, **fixed)
    right = values(rows, column, binding=other, **fixed)
    out: dict[str, dict[str, float]] = {}
    for scene, seed in sorted(left.keys() & right.keys(), key=lambda key: (scene_order(key[0]), key[1])):
        out.setdefault(scene, {})[seed] = left[scene, seed] - right[scene, seed]
    return out
