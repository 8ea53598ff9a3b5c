"""Depth of cavities, holes of masks, ends that are missing: against shapes whose figures are known."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from gsbridge.errors import InputError
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.photogrammetry.cavity import cavity_depth
from gsbridge.report.scores.measured_shapes import longest_side, shape_figures, vessel_figures, write_shape_figures
from gsbridge.report.scores.shape import hole_pixels, hole_scores, shape_scores, wrong_and_pass


def _standing(solid: trimesh.Trimesh) -> Mesh:
    solid.apply_translation([0, 0, -solid.bounds[0, 2]])
    return Mesh(np.asarray(solid.vertices, dtype=float), np.asarray(solid.faces))


def _ring(height: float) -> trimesh.Trimesh:
    return trimesh.creation.annulus(0.03, 0.04, height)


def _cup(depth: float, bottom: float = 0.006) -> Mesh:
    """A ring on a disc, which overlap a little."""
    wall = _ring(depth + bottom)
    wall.apply_translation([0, 0, (depth + bottom) / 2])
    disc = trimesh.creation.cylinder(0.035, bottom)
    disc.apply_translation([0, 0, bottom / 2])
    return _standing(trimesh.util.concatenate([wall, disc]))


@pytest.mark.parametrize("depth", [0.02, 0.06])
def test_depth_of_a_cup(depth):
    assert cavity_depth(_cup(depth)) == pytest.approx(depth, abs=1e-4)


def test_a_notch_in_the_rim_lets_water_out():
    cup = _cup(0.05)
    # Three quarters of the upper half of the wall are left: water stands to the half only.
    corners = cup.corners()
    notch = (corners[..., 0].mean(1) > 0.02) & (np.abs(corners[..., 1].mean(1)) < 0.02) & (corners[..., 2].max(1) > 0.05)
    vertices = cup.vertices.copy()
    vertices[np.unique(cup.faces[notch]), 2] = np.minimum(vertices[np.unique(cup.faces[notch]), 2], 0.03)
    assert cavity_depth(Mesh(vertices, cup.faces)) == pytest.approx(0.024, abs=2e-3)


def test_what_shows_the_table_holds_nothing():
    assert cavity_depth(_standing(_ring(0.05))) == 0
    assert cavity_depth(_standing(trimesh.creation.box([0.05, 0.05, 0.05]))) == 0
    assert cavity_depth(_cup(0.005)) == 0


def test_scores_tell_a_filled_cup_and_a_missing_end():
    true, filled = _cup(0.05), _standing(trimesh.creation.cylinder(0.04, 0.056))
    scores = shape_scores("visual", filled, true)
    assert scores["cavity_mm"] == pytest.approx(50, abs=0.2)
    assert scores["visual_cavity_error_mm"] == pytest.approx(-50, abs=0.2)
    assert scores["visual_extent_mm"] < 0.5
    short = Mesh(true.vertices * [1, 1, 0.8], true.faces)
    assert shape_scores("visual", short, true)["visual_extent_mm"] == pytest.approx(0.2 * 56, abs=1e-3)
    assert "cavity_mm" not in shape_scores("visual", true, filled)


def test_holes_are_counted_without_specks_and_bays():
    mask = np.zeros((40, 60))
    mask[5:35, 5:55] = 1
    mask[10:20, 10:20] = 0  # a hole
    mask[25:28, 25:28] = 0  # a speck
    mask[5:15, 40:45] = 0  # a bay
    assert hole_pixels(mask).sum() == 100
    found = mask.copy()
    found[10:20, 10:17] = 1
    assert hole_scores([(found, mask), (mask, mask)]) == {"holes": 200, "holes_found": pytest.approx(130 / 200)}
    assert hole_scores([(found, np.zeros_like(mask))]) == {"holes": 0}


GOOD = {
    "mask_iou_mean": 0.97,
    "visual_chamfer_mm": 1.0,
    "collision_chamfer_mm": 1.2,
    "visual_extent_mm": 1.0,
    "collision_extent_mm": 4.9,
    "visual_cavity_error_mm": -4.0,
    "collision_cavity_error_mm": 3.0,
}


def test_what_is_wrong_is_held_against_a_stage_that_passes_only():
    assert wrong_and_pass(GOOD, "pass", "pass") == []
    bad = {**GOOD, "visual_cavity_error_mm": -80.0, "collision_extent_mm": 6.0, "mask_iou_mean": 0.7}
    assert wrong_and_pass(bad, "pass", "pass") == [
        "mask IoU 0.700",
        "collision_extent_mm 6.0",
        "visual_cavity_error_mm -80.0",
    ]
    assert wrong_and_pass(bad, "degraded", "pass") == ["collision_extent_mm 6.0", "visual_cavity_error_mm -80.0"]
    assert wrong_and_pass(bad, "degraded", "degraded") == []


def test_figures_leave_degraded_meshes_beside_and_count_what_is_wrong():
    scores = [
        {"scene": "mug", **GOOD, "mesh_status": "pass", "wrong_and_pass": [], "holes_found": 0.5},
        {"scene": "pot", **GOOD, "visual_chamfer_mm": 9.0, "mesh_status": "degraded", "wrong_and_pass": []},
        {"scene": "toy", **GOOD, "mask_iou_mean": 0.94, "mesh_status": "pass", "wrong_and_pass": ["x"], "holes_found": 0.8},
        {"scene": "mug_turned", **GOOD, "visual_chamfer_mm": 3.0, "mesh_status": "pass", "wrong_and_pass": []},
    ]
    found = shape_figures(scores, ["mug_turned"])
    assert found["shapes_chamfer_visual_max"]["value"] == 1.0
    assert found["shapes_chamfer_visual_max"]["beside"] == {"degraded": {"pot": 9.0}}
    assert found["shapes_cavity_error_max"]["value"] == 4.0
    assert (found["shapes_wrong_and_pass"]["value"], found["shapes_wrong_and_pass"]["n"]) == (1, 4)
    assert found["shapes_mask_iou_min"]["value"] == 0.97
    assert found["shapes_mask_iou_harder_min"]["value"] == 0.94
    assert found["shapes_holes_found"]["value"] == pytest.approx(80)
    assert found["shapes_takes_chamfer_max"]["value"] == 3.0


def test_a_longest_side_gives_the_scale(tmp_path):
    """A reconstruction in units of 2 m, of which the board says 2.1 m and the mesh 3 % too little."""
    write_mesh(tmp_path / "mesh.ply", _standing(trimesh.creation.box((0.08, 0.05, 0.12))))
    for name, content in {"length": {"side": 0.97 * 0.06}, "align": {"scale": 2.1}, "score": {"scale_percent": 5.0}}.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    records = {name: str(tmp_path / f"{name}.json") for name in ("length", "align", "score")} | {"truth": str(tmp_path)}
    found = longest_side(records)
    assert (found["metres"], found["side"], found["true_scale"]) == pytest.approx((0.12, 0.0582, 2.0))
    assert found["error_percent"] == pytest.approx(100 * (1 / 0.97 - 1), abs=1e-3)
    (tmp_path / "length.json").write_text(json.dumps({"side": 0}))
    with pytest.raises(InputError, match=r"length\.json: a length or a scale is not above 0"):
        longest_side(records)
    (tmp_path / "align.json").write_text("{}")
    with pytest.raises(InputError, match=r"align\.json: 'scale' is missing"):
        longest_side(records)


def test_vessels_count_by_their_worst_starts(tmp_path):
    counts = {"success": {"fixed": 32, "unseen": 29}, "success_tolerant": {"fixed": 32, "unseen": 31}}
    record = {"task": "grasp", "poses": 32, "seeds": [1, 2, 3], "counts": counts}
    (tmp_path / "trials.json").write_text(json.dumps(record))
    (tmp_path / "few.json").write_text(json.dumps({**record, "poses": 8}))
    (tmp_path / "open.json").write_text(json.dumps({"rim": {"depth": 0.03}}))
    (tmp_path / "solid.json").write_text(json.dumps({"rim": None}))

    def paths(trials="trials", asset="open"):
        return {"trials": str(tmp_path / f"{trials}.json"), "asset": str(tmp_path / f"{asset}.json")}

    found = vessel_figures({"sim": {"mug+pad": paths()}, "mirror": {"mug+pad": paths(), "bowl+pad": paths()}})
    assert found["shapes_rim_sim"]["value"] == 29
    assert (found["shapes_rim_mirror"]["value"], found["shapes_rim_mirror"]["n"], found["shapes_rim_mirror"]["seeds"]) == (
        31,
        2,
        3,
    )
    # A controller that takes the whole body takes no wall.
    assert vessel_figures({"sim": {"mug+pad": paths(), "bowl+pad": paths(asset="solid")}})["shapes_rim_sim"]["value"] == 0
    assert vessel_figures({"sim": {"mug+pad": paths("few")}}) == {}


def test_the_figures_of_longest_sides_are_written(tmp_path):
    write_mesh(tmp_path / "mesh.ply", _standing(trimesh.creation.box((0.08, 0.05, 0.12))))
    for name, content in {"length": {"side": 0.123}, "align": {"scale": 1.0}, "score": {"scale_percent": 0.0}}.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    records = {name: str(tmp_path / f"{name}.json") for name in ("length", "align", "score")} | {"truth": str(tmp_path)}
    outputs = tmp_path / "measured.json", tmp_path / "longest.json"
    write_shape_figures(*outputs, scene_scores=[], takes=[], longest={"box": records}, trials={})
    figures = json.loads(outputs[0].read_text())["figures"]
    assert figures["shapes_longest_scale_max"]["by_scene"]["box"] == pytest.approx(100 * (1 - 0.12 / 0.123), abs=1e-3)
    assert json.loads(outputs[1].read_text())["objects"][0]["scene"] == "box"
