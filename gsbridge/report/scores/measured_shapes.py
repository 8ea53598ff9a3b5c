"""Figures of the area `shapes`: hollow, wide-footed, see-through and plain things, and other takes of them.

Meshes of a stage that says `degraded` are shown beside the figures but not compared with floors. Wrong meshes and masks of a
stage that says `pass` count in the figure `shapes_wrong_and_pass`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.files import read_json
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


def write_shape_figures(
    out: str | Path, *, scene_scores: Sequence[str | Path], takes: Sequence[str], preset: str | None = None
) -> None:
    """Gather all figures of the area and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        scene_scores: Scores of each scene.
        takes: See `shape_figures`.
        preset: Preset that ran.

    Raises:
        InputError: A file is damaged.
    """
    write_measured(
        out,
        preset,
        lambda: shape_figures([read_json(path) for path in scene_scores], takes),
        damaged="the scores of a scene are",
    )
