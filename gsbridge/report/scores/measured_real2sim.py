"""Figures of the area `real2sim`, gathered from scene scores, rows and benchmarks under the names of `floors.yaml`.

A figure is `{value, n, interval, interval_of, where, …}`; one that cannot be formed from what is there is left out, and the
`score` rule then counts it as unmet. `n` is the number of scenes behind it, `seeds` the smallest number of seeds of any
scene.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.report.tables.film_ceilings import read_ceilings
from gsbridge.report.tables.rendering_rows import COLUMNS, differences, mean_by_scene, values
from gsbridge.report.tables.rows import Row, read_rows

Figure = dict[str, Any]

RENDERING_ROWS = "results/rows/rendering.csv"
SCENE_SCORES = "results/scores/scenes/"
RASTERIZER = "results/benchmarks/rasterizer.json"


def over_scenes(by_scene: Mapping[str, float], summary: Callable[[list[float]], float], where: str, **more: Any) -> Figure:
    """One figure from a value per scene.

    Args:
        by_scene: Value of each scene.
        summary: `min`, `max`, `statistics.median` or `statistics.fmean`.
        where: File that the values come from.
        **more: Further entries.

    Returns:
        The figure; its interval is Student's 95 % interval of the mean for a mean over at least two scenes, and the range
        over the scenes otherwise.
    """
    found = list(by_scene.values())
    interval, meaning = [min(found), max(found)], "range over scenes"
    if summary is statistics.fmean and len(found) > 1:
        half = float(stats.t.ppf(0.975, len(found) - 1)) * statistics.stdev(found) / len(found) ** 0.5
        interval, meaning = [summary(found) - half, summary(found) + half], "95 % of the mean over scenes (Student)"
    return {
        "value": summary(found),
        "n": len(found),
        "interval": interval,
        "interval_of": meaning,
        "by_scene": dict(by_scene),
        "where": where,
        **more,
    }


def reconstruction_figures(scores: Sequence[Mapping[str, Any]]) -> dict[str, Figure]:
    """Figures of capture, sfm, align, masks and mesh, from the scores of the scenes."""
    out: dict[str, Figure] = {}

    def add(figure: str, key: str, summary: Callable[[list[float]], float], magnitude: bool = False) -> None:
        found = {score["scene"]: float(score[key]) for score in scores if score.get(key) is not None}
        if found:
            found = {scene: abs(value) for scene, value in found.items()} if magnitude else found
            out[figure] = over_scenes(found, summary, SCENE_SCORES)

    add("keyframes_registered_min", "registered_percent", min)
    add("camera_error_median", "camera_mm_median", statistics.median)
    add("camera_error_max", "camera_mm_median", max)
    add("scale_error_median", "scale_percent", statistics.median, magnitude=True)
    add("scale_error_max", "scale_percent", max, magnitude=True)
    add("tilt_max", "tilt_deg", max)
    add("height_error_max", "height_mm", max)
    add("mask_iou_mean_min", "mask_iou_mean", min)
    add("mask_iou_min_min", "mask_iou_min", min)
    add("mask_iou_median", "mask_iou_mean", statistics.median)
    add("chamfer_visual_max", "visual_chamfer_mm", max)
    add("chamfer_visual_median", "visual_chamfer_mm", statistics.median)
    add("chamfer_collision_max", "collision_chamfer_mm", max)
    add("background_long_side_min", "table_long_m", min)
    add("background_short_side_min", "table_short_m", min)
    add("background_outside_max", "table_outside_percent", max)
    closed = {
        score["scene"]: float(score["visual_watertight"] and score["collision_watertight"])
        for score in scores
        if "visual_watertight" in score
    }
    if closed:
        out["objects_watertight"] = over_scenes(closed, min, SCENE_SCORES)
    return out


def rendering_figures(rows: Sequence[Row]) -> dict[str, Figure]:
    """Figures of the splats: differences between bindings and quality of `soft`, masked, on held-out views of the mirror."""
    out: dict[str, Figure] = {}
    mirror = [row for row in rows if row["origin"] == "mirror"]
    objects = [row for row in mirror if row["kind"] == "object"]
    backgrounds = [row for row in mirror if row["kind"] == "background"]

    def add(
        figure: str, found: list[Row], better: str, other: str, summary: Callable[[list[float]], float], surface: str
    ) -> None:
        pairs = differences(found, better, other, split="held_out", region="masked", surface=surface)
        if pairs:
            means = {scene: statistics.fmean(seeds.values()) for scene, seeds in pairs.items()}
            fewest = min(len(seeds) for seeds in pairs.values())
            out[figure] = over_scenes(means, summary, RENDERING_ROWS, seeds=fewest, by_scene_and_seed=pairs)

    add("soft_minus_games_objects_min", objects, "soft", "games", min, "visual")
    add("soft_minus_games_objects_mean", objects, "soft", "games", statistics.fmean, "visual")
    add("soft_minus_games_hull_mean", objects, "soft", "games", statistics.fmean, "hull")
    add("soft_minus_games_backgrounds_min", backgrounds, "soft", "games", min, "visual")
    add("soft_minus_games_all_mean", mirror, "soft", "games", statistics.fmean, "visual")
    add("refined_minus_soft_mean", mirror, "refined", "soft", statistics.fmean, "visual")
    add("unbound_minus_refined_mean", mirror, "unbound", "refined", statistics.fmean, "visual")
    add("unbound_minus_refined_max", mirror, "unbound", "refined", max, "visual")
    for figure, column in (("soft_psnr_objects_min", "psnr"), ("soft_alpha_iou_min", "alpha_iou")):
        found = mean_by_scene(
            values(objects, column, binding="soft", split="held_out", region="masked", surface="visual", main="true")
        )
        if found:
            out[figure] = over_scenes(found, min, RENDERING_ROWS)
    return out


def ceiling_figures(rows: Sequence[Row], films: Mapping[str, float]) -> dict[str, Figure]:
    """How far `soft` stays below what the film's own noise allows, objects only.

    Args:
        rows: Rows of `rendering.csv`.
        films: Ceiling of the held-out photos of each scene inside the mask, dB.
    """
    psnrs = mean_by_scene(
        values(rows, "psnr", binding="soft", split="held_out", region="masked", surface="visual", main="true", kind="object")
    )
    below = {scene: films[scene] - psnr for scene, psnr in psnrs.items() if scene in films}
    beside = {"noise ceiling of the held-out photos, masked": {scene: films[scene] for scene in below}}
    return {"soft_below_ceiling_max": over_scenes(below, max, RENDERING_ROWS, beside=beside)} if below else {}


def real_figures(captures: Mapping[str, Mapping[str, str | Path]]) -> dict[str, Figure]:
    """Figures of real captures, which have no truth.

    Args:
        captures: {scene: {keyframes: keyframes.json, sfm: sfm.json}}.

    Returns:
        `{scene}_registered` (images), `{scene}_registered_percent`, `{scene}_decoded` (frames of a video).
    """
    out: dict[str, Figure] = {}
    for scene, files in captures.items():
        record, capture = read_json(files["sfm"]), read_json(files["keyframes"])
        registered, total = int(record["registered"]), int(record["total"])
        where = f"results/scenes/{scene}/"
        out[f"{scene}_registered"] = {"value": registered, "n": total, "interval": None, "where": where}
        out[f"{scene}_registered_percent"] = {"value": 100.0 * registered / total, "n": total, "interval": None, "where": where}
        if capture.get("decoded") is not None:
            out[f"{scene}_decoded"] = {"value": int(capture["decoded"]), "n": 1, "interval": None, "where": where}
    return out


def rasterizer_figures(benchmark: str | Path) -> dict[str, Figure]:
    """Figures of the CPU rasteriser on one core, from the output of `benchmarks/rasterizer.py --json`.

    Nothing is taken from a run with another backend or more threads; parts that were not run are left out.

    Raises:
        InputError: The file is damaged.
    """
    content = read_json(benchmark)
    try:
        if content["backend"] != "cpu" or content["threads"] != 1:
            return {}
        whole, step = content["scenes"].get("whole_50k_128"), content["scenes"].get("train_30k_256")
        out: dict[str, Figure] = {}
        for name, scene in (("forward", whole), ("step", step)):
            for summary in ("min", "median") if scene else ():
                interval = [float(scene["min_ms"]), float(scene["median_ms"])]
                figure = {"value": float(scene[f"{summary}_ms"]), "n": int(scene["repeats"]), "interval": interval}
                out[f"rasterizer_{name}_{summary}"] = {**figure, "interval_of": "fastest and median repeat"}
        if step and "speedup" in step:
            out["rasterizer_speedup"] = {"value": float(step["speedup"]), "n": int(step["repeats"]), "interval": None}
        if errors := content.get("gradient_relative_error"):
            worst = {name: float(error) for name, error in errors.items()}
            figure = {"value": max(worst.values()), "n": len(worst), "interval": [min(worst.values()), max(worst.values())]}
            out["rasterizer_gradient_error"] = {**figure, "interval_of": "range over parameter groups"}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(benchmark, f"the benchmark is damaged ({error!r})", "Delete it and measure again") from error
    return {name: {**figure, "where": RASTERIZER} for name, figure in out.items()}


def write_real2sim_figures(
    out: str | Path,
    *,
    scene_scores: Sequence[str | Path],
    rendering_csv: str | Path,
    films: Mapping[str, str | Path],
    real: Mapping[str, Mapping[str, str | Path]],
    rasterizer: str | Path | None = None,
    preset: str | None = None,
) -> None:
    """Gather all figures of the area and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        scene_scores: Files written by `score_real2sim.write_scene_score`.
        rendering_csv: `rows/rendering.csv`.
        films: `film.json` of each mirrored object.
        real: Files of each real capture, as in `real_figures`.
        rasterizer: Output of `benchmarks/rasterizer.py --json`; None where it was not run.
        preset: Preset that ran, so that figures of several presets can be scored together.
    """
    rows = read_rows(rendering_csv, COLUMNS)
    ceilings = {scene: read_ceilings(path).get(("held_out", "masked")) for scene, path in films.items()}
    figures = {
        **reconstruction_figures([read_json(path) for path in scene_scores]),
        **rendering_figures(rows),
        **ceiling_figures(rows, {scene: value for scene, value in ceilings.items() if value is not None}),
        **real_figures(real),
        **(rasterizer_figures(rasterizer) if rasterizer is not None else {}),
    }
    shown = {name: {**figure, "value": _finite(figure["value"])} for name, figure in figures.items()}
    write_json(out, {"preset": preset, "figures": shown})


def _finite(value: float) -> float | None:
    """The value, or None where it is no number: such a figure was not measured."""
    return value if np.isfinite(value) else None
