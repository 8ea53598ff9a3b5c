"""Figures of the area `shapes`: hollow, wide-footed, see-through and plain things, and other takes of them.

Meshes of a stage that says `degraded` are shown beside the figures but not compared with floors. Wrong meshes and masks of a
stage that says `pass` count in the figure `shapes_wrong_and_pass`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.meshes import read_mesh
from gsbridge.photogrammetry.standing import box_sides
from gsbridge.report.scores.measured_scenes import trial_figures
from gsbridge.report.scores.score import Figure, over_scenes, single, write_measured

_WHERE = "results/scores/scenes/"
_HARDER = ("statue", "toy")
"""Objects whose masks have a floor of their own: the foot of one looks like the table, the other has windows."""
_SEEN_THROUGH = "toy"


def shape_figures(scores: Sequence[Mapping[str, Any]], takes: Sequence[str]) -> dict[str, Figure]:
    """Make the figures of all scenes of the area.

    Args:
        scores: Scores of each scene, as `score_scene` writes them.
        takes: Names of the scenes that are further takes of an object.
    """
    out: dict[str, Figure] = {}

    def add(
        figure: str,
        found: Mapping[str, float],
        summary: Callable[[list[float]], float],
        beside: Mapping[str, float] | None = None,
    ) -> None:
        if found:
            out[figure] = over_scenes(found, summary, _WHERE, beside={"degraded": dict(beside)} if beside else None)

    plain = [score for score in scores if score["scene"] not in takes]
    sure = {score["scene"] for score in plain if score["mesh_status"] == "pass"}
    for figure, keys in (
        ("shapes_chamfer_visual_max", ("visual_chamfer_mm",)),
        ("shapes_chamfer_collision_max", ("collision_chamfer_mm",)),
        ("shapes_cavity_error_max", ("visual_cavity_error_mm", "collision_cavity_error_mm")),
    ):
        found = {score["scene"]: max(abs(score[key]) for key in keys) for score in plain if keys[0] in score}
        add(
            figure,
            {scene: value for scene, value in found.items() if scene in sure},
            max,
            {scene: value for scene, value in found.items() if scene not in sure},
        )
    overlaps = {score["scene"]: score["mask_iou_mean"] for score in plain}
    add("shapes_mask_iou_min", {scene: value for scene, value in overlaps.items() if scene not in _HARDER}, min)
    add("shapes_mask_iou_harder_min", {scene: value for scene, value in overlaps.items() if scene in _HARDER}, min)
    holes = {score["scene"]: 100 * score["holes_found"] for score in plain if "holes_found" in score}
    if _SEEN_THROUGH in holes:
        beside = {"holes of other objects": {scene: value for scene, value in holes.items() if scene != _SEEN_THROUGH}}
        out["shapes_holes_found"] = over_scenes({_SEEN_THROUGH: holes[_SEEN_THROUGH]}, min, _WHERE, beside=beside)
    wrong = {score["scene"]: float(len(score["wrong_and_pass"])) for score in scores}
    if wrong:
        count = sum(value > 0 for value in wrong.values())
        out["shapes_wrong_and_pass"] = single(count, len(wrong), _WHERE) | {"by_scene": wrong}
    taken = {score["scene"]: score["visual_chamfer_mm"] for score in scores if score["scene"] in takes}
    add("shapes_takes_chamfer_max", taken, max)
    return out


def longest_side(records: Mapping[str, str]) -> dict[str, float]:
    """Compare the scale that the longest side of an object would give with the true one.

    Where the board shows in the film, as in those of the mirror, cameras are better and the table is easier to find than a user
    without a board can expect; the scale itself does not use the board.

    Args:
        records: Paths by name: `length` (the longest side in the units of the reconstruction), `align` (whose scale comes from
            the board), `score` (which says by how much that scale is wrong) and `truth` (a folder that holds `mesh.ply`, m).

    Returns:
        `metres` (the true longest side), `side` (the same in the units of the reconstruction), `true_scale` (m per unit), and
        `error_percent`.

    Raises:
        InputError: A record is damaged.
    """
    side = _number(records["length"], "side")
    true_scale = _number(records["align"], "scale") / (1.0 + _number(records["score"], "scale_percent") / 100)
    if not (side > 0 and true_scale > 0):
        raise InputError(records["length"], "a length or a scale is not above 0", "Delete the scene, and make it again")
    metres = float(box_sides(read_mesh(Path(records["truth"], "mesh.ply")).vertices).max())
    return {
        "metres": metres,
        "side": side,
        "true_scale": true_scale,
        "error_percent": 100.0 * (metres / side / true_scale - 1.0),
    }


def vessel_figures(trials: Mapping[str, Mapping[str, Mapping[str, str]]]) -> dict[str, Figure]:
    """Make the figures of the controller that takes vessels by their wall: successes of 32, from the worst set of starts.

    Args:
        trials: Paths of the record of the `trials` and of the vessel's `asset`, by world (`sim` or `mirror`) and
            `object+background`. A vessel whose asset has no place at which its wall can be taken counts as 0.

    Raises:
        InputError: A record is damaged.
    """
    out = {}
    for world, found in trials.items():
        whole = trial_figures([(pair, read_json(paths["trials"])) for pair, paths in found.items()], world)
        figure = whole.get(f"controller_grasp_{world}")
        if figure is None:
            continue
        solid = {pair for pair, paths in found.items() if read_json(paths["asset"]).get("rim") is None}
        by_scene = {pair: 0.0 if pair in solid else value for pair, value in figure["by_scene"].items()}
        out[f"shapes_rim_{world}"] = figure | over_scenes(by_scene, min, "results/trials/")
    return out


def write_shape_figures(
    out: str | Path,
    out_longest: str | Path,
    *,
    scene_scores: Sequence[str | Path],
    takes: Sequence[str],
    longest: Mapping[str, Mapping[str, str]],
    trials: Mapping[str, Mapping[str, Mapping[str, str]]],
    preset: str | None = None,
) -> None:
    """Gather all figures of the area and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        out_longest: What `longest_side` found, by object.
        scene_scores: Scores of each scene.
        takes: See `shape_figures`.
        longest: Records of each object, see `longest_side`.
        trials: See `vessel_figures`.
        preset: Preset that ran.

    Raises:
        InputError: A file is damaged.
    """
    sides = {name: longest_side(records) for name, records in longest.items()}
    write_json(out_longest, {"objects": [{"scene": name, **found} for name, found in sides.items()]})
    errors = {name: abs(found["error_percent"]) for name, found in sides.items()}

    def figures() -> dict[str, Figure]:
        shapes = shape_figures([read_json(path) for path in scene_scores], takes) | vessel_figures(trials)
        return shapes | ({"shapes_longest_scale_max": over_scenes(errors, max, "results/scenes/")} if errors else {})

    write_measured(out, preset, figures, damaged="the scores of a scene or records of trials are")


def _number(path: str, key: str) -> float:
    """Read one number of a record.

    Raises:
        InputError: The record is damaged or does not hold the number.
    """
    try:
        return float(read_json(path)[key])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(path, f"'{key}' is missing or no number ({error!r})", "Delete it, and make it again") from error
