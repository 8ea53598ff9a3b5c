"""Figures of the area `simulator`, gathered from records, rows and benchmarks under the names of `floors.yaml`.

A figure that cannot be formed from what is there is left out, and the `score` rule then counts it as unmet.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.report.figures.eye_in_hand import COLUMNS
from gsbridge.report.scores.measured_real2sim import Figure, over_scenes
from gsbridge.report.tables.rows import Row, read_rows

TASKS = {"grasp": "grasp", "pick_and_place": "place"}
JUDGED = {"sim": "success", "mirror": "success_tolerant"}
"""Excess contact is a failure in simulation only. Source: RL-GSBridge, experiments."""


def trial_figures(records: Sequence[tuple[str, Mapping[str, Any]]], world: str) -> dict[str, Figure]:
    """Successes of the baseline controllers in one world: the worst set of 32 starts of any object.

    Args:
        records: `object+background` and the trials' record, of any task.
        world: `sim` or `mirror`.

    Returns:
        `controller_{grasp,place}_{world}`; sets of fewer than 32 starts are left out.
    """
    judged, other = JUDGED[world], ({"success", "success_tolerant"} - {JUDGED[world]}).pop()
    out: dict[str, Figure] = {}
    for task, short in TASKS.items():
        found = {pair.split("+")[0]: record for pair, record in records if record["task"] == task and record["poses"] == 32}
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
    """PSNR of splats against the mirror's pictures, and their lead over the better mesh control; meshes have no shadows."""
    psnr: dict[str, dict[str, float]] = {}
    for row in rows:
        psnr.setdefault(f"{row['object']}+{row['background']}", {})[row["renderer"]] = float(row["psnr"])
    if not psnr:
        return {}
    views = min(int(row["views"]) for row in rows)
    where = "results/rows/eye_in_hand.csv"

    def lead(renderer: str) -> dict[str, float]:
        return {p: found[renderer] - max(found["mesh"], found["mesh_vertex"]) for p, found in psnr.items() if renderer in found}

    controls = {name: {pair: found[name] for pair, found in psnr.items()} for name in ("mesh_vertex", "mesh")}
    splats = {pair: found["gs"] for pair, found in psnr.items()}
    out = {
        "eye_in_hand_gs_min": over_scenes(splats, min, where, views=views, beside=controls),
        "eye_in_hand_lead_min": over_scenes(lead("gs"), min, where, views=views),
    }
    if unshaded := lead("gs_unshaded"):
        out["eye_in_hand_lead_unshaded_min"] = over_scenes(unshaded, min, where, views=views)
    return out


def asset_figures(assets: Mapping[str, Mapping[str, Any]]) -> dict[str, Figure]:
    """How quietly the bodies rest, and how much of the splat stage's PSNR the bundles keep; by scene."""
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
    """Twin, repetition and coverage."""
    where = "results/robot/simulator.json"
    covered = {pair: float(record["coverage"]["min"]) for pair, record in views.items()}
    out = {
        "twin_tool_max": {"value": float(checks["twin"]["tool_mm"]), "n": 1, "interval": None, "where": where},
        "sim_repeats": {
            "value": float(checks["repeated"]["identical"]),
            "n": int(checks["repeated"]["repetitions"]),
            "interval": None,
            "where": where,
        },
    }
    if covered:
        out["coverage_min"] = over_scenes(
            covered, min, "results/views/", views=min(record["views"] for record in views.values())
        )
    return out


def registration_figures(scores: Mapping[str, Mapping[str, float]]) -> dict[str, Figure]:
    """Errors of the registration."""
    where = "results/scores/workspace/registration.json"
    names = {"base_from_table": "table", "flange_from_camera": "camera"}
    return {
        f"registration_{short}_{unit}": {"value": float(scores[name][unit]), "n": 1, "interval": None, "where": where}
        for name, short in names.items()
        for unit in ("mm", "deg")
    }


def environment_figures(benchmark: Mapping[str, Any]) -> dict[str, Figure]:
    """Speed, from the output of `benchmarks/environment.py --json`; parts that were not run are left out."""
    where = "results/benchmarks/environment.json"
    out: dict[str, Figure] = {}
    for size in (128, 64):
        if found := benchmark.get(f"gs_{size}"):
            rate, slowest = float(found["steps_per_second"]), 1e3 / float(found["slowest_round_ms"])
            figure = {"value": rate, "n": int(found["steps"]), "interval": [slowest, rate]}
            told = f"slowest and fastest of {int(found['rounds'])} rounds"
            out[f"environment_steps_{size}"] = {**figure, "interval_of": told, "where": where}
    if found := benchmark.get("mirror_64"):
        times = [float(found["seconds_min"]), float(found["seconds_median"])]
        figure = {"value": times[1], "n": int(found["pictures"]), "interval": times}
        out["mirror_image_64"] = {**figure, "interval_of": "fastest and median picture", "where": where}
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
    try:
        figures = {
            **trial_figures([(Path(path).parent.name, read_json(path)) for path in sim], "sim"),
            **trial_figures([(Path(path).parent.name, read_json(path)) for path in mirror], "mirror"),
            **asset_figures({Path(path).parent.parent.name: read_json(path) for path in assets}),
            **single_figures(read_json(checks), {Path(path).parent.name: read_json(path) for path in views}),
            **eye_in_hand_figures(read_rows(eye_in_hand, COLUMNS)),
            **registration_figures(read_json(registration)),
            **environment_figures(read_json(environment)),
        }
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            out, f"a record of the simulator is damaged ({error!r})", "Delete the records that it is made of and run again"
        ) from error
    write_json(out, {"preset": preset, "figures": figures})
