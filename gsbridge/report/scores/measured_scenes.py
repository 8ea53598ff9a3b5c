"""Figures of the areas `real2sim` and `simulator`, gathered from records, rows and benchmarks under the names of `floors.yaml`.

A figure that cannot be formed from what is there is left out, and the `score` rule then counts it as unmet. `n` is the number
of scenes behind a figure, `seeds` the smallest number of seeds of any scene.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.report.figures.eye_in_hand import COLUMNS as EYE_IN_HAND_COLUMNS
from gsbridge.report.scores.score import Figure, over_scenes, single, write_measured
from gsbridge.report.tables.rendering_rows import COLUMNS, differences, mean_by_scene, read_ceilings, values
from gsbridge.report.tables.rows import Row, read_rows

RENDERING_ROWS = "results/rows/rendering.csv"
SCENE_SCORES = "results/scores/scenes/"
RASTERIZER = "results/benchmarks/rasterizer.json"


def reconstruction_figures(scores: Sequence[Mapping[str, Any]]) -> dict[str, Figure]:
    """Make the figures of capture, sfm, align, masks and mesh, from the scores of the scenes."""
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
    """Make the figures of the splats: gains between bindings, quality of `soft`; masked, on held-out views of the mirror."""
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
    add("soft_minus_games_vertices_all_mean", mirror, "soft", "games_vertices", statistics.fmean, "visual")
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
    """How far the PSNR of `soft` stays below the noise ceiling of the film, dB; objects only.

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
    """Make the figures of real captures, for which no truth is known.

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
        out[f"{scene}_registered"] = single(registered, total, where)
        out[f"{scene}_registered_percent"] = single(100.0 * registered / total, total, where)
        if capture.get("decoded") is not None:
            out[f"{scene}_decoded"] = single(int(capture["decoded"]), 1, where)
    return out


def rasterizer_figures(benchmark: str | Path) -> dict[str, Figure]:
    """Make the figures of the CPU rasteriser on one core, from the output of `benchmarks/rasterizer.py --json`.

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
                value, between = float(scene[f"{summary}_ms"]), [float(scene["min_ms"]), float(scene["median_ms"])]
                told = (between, "fastest and median repeat")
                out[f"rasterizer_{name}_{summary}"] = single(value, int(scene["repeats"]), RASTERIZER, *told)
        if step and "speedup" in step:
            out["rasterizer_speedup"] = single(float(step["speedup"]), int(step["repeats"]), RASTERIZER)
        if errors := content.get("gradient_relative_error"):
            worst = sorted(float(error) for error in errors.values())
            told = ([worst[0], worst[-1]], "range over parameter groups")
            out["rasterizer_gradient_error"] = single(worst[-1], len(worst), RASTERIZER, *told)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(benchmark, f"the benchmark is damaged ({error!r})", "Delete it and measure again") from error
    return out


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
        scene_scores: Files written by `gsbridge.report.scores.scene.write_scene_score`.
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
    # `write_json` turns NaN and infinity into null, and such a figure counts as not measured.
    write_json(out, {"preset": preset, "figures": figures})


TASKS = {"grasp": "grasp", "pick_and_place": "place"}
JUDGED = {"sim": "success", "mirror": "success_tolerant"}
"""Count of successes in each world: excess contact is a failure in simulation only. Source: RL-GSBridge, experiments."""


def trial_figures(records: Sequence[tuple[str, Mapping[str, Any]]], world: str) -> dict[str, Figure]:
    """Successes of the baseline controllers in one world, from the worst set of 32 starts of any pair.

    Args:
        records: Name `object+background` and record of the trials, of any task.
        world: `sim` or `mirror`.

    Returns:
        `controller_{grasp,place}_{world}`; sets of fewer than 32 starts are left out.
    """
    judged, other = JUDGED[world], ({"success", "success_tolerant"} - {JUDGED[world]}).pop()
    out: dict[str, Figure] = {}
    for task, short in TASKS.items():
        found = {pair: record for pair, record in records if record["task"] == task and record["poses"] == 32}
        if found:
            worst = {
                key: {name: float(min(record["counts"][key].values())) for name, record in found.items()}
                for key in (judged, other)
            }
            seeds = min(len(record["seeds"]) for record in found.values())
            title = f"{short} in {world}, excess contact {'forgiven' if other == 'success_tolerant' else 'a failure'}"
            out[f"controller_{short}_{world}"] = over_scenes(
                worst[judged], min, "results/trials/", seeds=seeds, beside={title: worst[other]}
            )
    return out


def eye_in_hand_figures(rows: Sequence[Row]) -> dict[str, Figure]:
    """PSNR of splats against the mirror's pictures, and its lead over the better mesh control, dB.

    `eye_in_hand_lead_shaded_min` and `eye_in_hand_lead_unshaded_min` compare like with like: both sides draw the shadows of
    robot and object, or neither does.
    """
    psnr: dict[str, dict[str, float]] = {}
    for row in rows:
        psnr.setdefault(f"{row['object']}+{row['background']}", {})[row["renderer"]] = float(row["psnr"])
    if not psnr:
        return {}
    views = min(int(row["views"]) for row in rows)
    where = "results/rows/eye_in_hand.csv"

    def lead(renderer: str, controls: tuple[str, str] = ("mesh", "mesh_vertex")) -> dict[str, float]:
        named = {renderer, *controls}
        return {p: found[renderer] - max(found[c] for c in controls) for p, found in psnr.items() if named <= set(found)}

    controls = {name: {pair: found[name] for pair, found in psnr.items()} for name in ("mesh_vertex", "mesh")}
    splats = {pair: found["gs"] for pair, found in psnr.items()}
    out = {
        "eye_in_hand_gs_min": over_scenes(splats, min, where, views=views, beside=controls),
        "eye_in_hand_lead_min": over_scenes(lead("gs"), min, where, views=views),
    }
    if shaded := lead("gs", ("mesh_shaded", "mesh_vertex_shaded")):
        out["eye_in_hand_lead_shaded_min"] = over_scenes(shaded, min, where, views=views)
    if unshaded := lead("gs_unshaded"):
        out["eye_in_hand_lead_unshaded_min"] = over_scenes(unshaded, min, where, views=views)
    return out


def asset_figures(assets: Mapping[str, Mapping[str, Any]]) -> dict[str, Figure]:
    """Make the figures of how far bodies sink in, drift and turn at rest, and of the PSNR that bundles lose; by scene."""
    out: dict[str, Figure] = {}

    def add(figure: str, value: Callable[[Mapping[str, Any]], float], summary: Callable[[list[float]], float]) -> None:
        out[figure] = over_scenes({name: float(value(asset)) for name, asset in assets.items()}, summary, "results/scenes/")

    if assets:
        add("asset_penetration_max", lambda asset: asset["rest"]["penetration_mm"], max)
        add("asset_drift_max", lambda asset: asset["rest"]["drift_mm"], max)
        add("asset_turn_max", lambda asset: asset["rest"]["drift_deg"], max)
        add("asset_psnr_loss_max", lambda asset: asset["photos"]["stage_psnr"] - asset["photos"]["psnr"], max)
    return out


def single_figures(checks: Mapping[str, Any], views: Mapping[str, Mapping[str, Any]]) -> dict[str, Figure]:
    """Make the figures of the simulator's checks `twin` and `repeated`, and of the coverage of the drawn views."""
    where = "results/robot/simulator.json"
    covered = {pair: float(record["coverage"]["min"]) for pair, record in views.items()}
    out = {
        "twin_tool_max": single(float(checks["twin"]["tool_mm"]), 1, where),
        "sim_repeats": single(float(checks["repeated"]["identical"]), int(checks["repeated"]["repetitions"]), where),
    }
    if covered:
        out["coverage_min"] = over_scenes(
            covered, min, "results/views/", views=min(record["views"] for record in views.values())
        )
    return out


def registration_figures(scores: Mapping[str, Mapping[str, float]]) -> dict[str, Figure]:
    """Make the figures of the registration's errors, mm and degrees."""
    where = "results/scores/workspace/registration.json"
    names = {"base_from_table": "table", "flange_from_camera": "camera"}
    return {
        f"registration_{short}_{unit}": single(float(scores[name][unit]), 1, where)
        for name, short in names.items()
        for unit in ("mm", "deg")
    }


def environment_figures(benchmark: Mapping[str, Any]) -> dict[str, Figure]:
    """Make the figures of speed from `benchmarks/environment.py --json`; parts that were not run are left out."""
    where = "results/benchmarks/environment.json"
    out: dict[str, Figure] = {}
    for size in (128, 64):
        if found := benchmark.get(f"gs_{size}"):
            rate, slowest = float(found["steps_per_second"]), 1e3 / float(found["slowest_round_ms"])
            told = f"slowest and fastest of {int(found['rounds'])} rounds"
            out[f"environment_steps_{size}"] = single(rate, int(found["steps"]), where, [slowest, rate], told)
    for ending in ("", "_severity_2"):
        if found := benchmark.get(f"mirror_64{ending}"):
            times = [float(found["seconds_min"]), float(found["seconds_median"])]
            out[f"mirror_image_64{ending}"] = single(
                times[1], int(found["pictures"]), where, times, "fastest and median picture"
            )
    return out


def write_simulator_figures(
    out: str | Path,
    *,
    assets: Sequence[str | Path],
    sim: Sequence[str | Path],
    mirror: Sequence[str | Path],
    checks: str | Path,
    views: Sequence[str | Path],
    eye_in_hand: str | Path,
    registration: str | Path,
    environment: str | Path,
    preset: str | None = None,
) -> None:
    """Gather all figures of the area and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        assets: `{scene}/asset/asset.json` of the objects.
        sim, mirror: `{task}/{object}+{background}/{world}.json` of the trials.
        checks: Record of `check_simulator`.
        views: `{object}+{background}/drawn.json` of the drawn views.
        eye_in_hand: `rows/eye_in_hand.csv`.
        registration: Scores of the registration.
        environment: Output of `benchmarks/environment.py --json`.
        preset: Preset that ran.

    Raises:
        InputError: A file is damaged.
    """

    def gather() -> dict[str, Figure]:
        return {
            **trial_figures([(Path(path).parent.name, read_json(path)) for path in sim], "sim"),
            **trial_figures([(Path(path).parent.name, read_json(path)) for path in mirror], "mirror"),
            **asset_figures({Path(path).parent.parent.name: read_json(path) for path in assets}),
            **single_figures(read_json(checks), {Path(path).parent.name: read_json(path) for path in views}),
            **eye_in_hand_figures(read_rows(eye_in_hand, EYE_IN_HAND_COLUMNS)),
            **registration_figures(read_json(registration)),
            **environment_figures(read_json(environment)),
        }

    write_measured(out, preset, gather, damaged="a record of the simulator is")
