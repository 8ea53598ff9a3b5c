"""The table frame against scenes whose table, scale and object are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from posed_scene import BOARD, LENS, cloud, local, model_of, moved, names, orbit, sightings

from gsbridge.align import AlignSettings, align_scene
from gsbridge.align.board_fit import fit_board
from gsbridge.align.length import KnownLength, table_point
from gsbridge.align.plane import attention, find_table
from gsbridge.align.stage import object_points
from gsbridge.cameras import Camera, camera_centre, look_at, split_of
from gsbridge.errors import InputError, StageError
from gsbridge.files import write_json
from gsbridge.geometry import Array, Similarity, rotation_angle, rotation_between
from gsbridge.photogrammetry.standing import box_sides, find_standing

PINHOLE = LENS.undistorted()
POSES = orbit(24)
AWAY = Similarity(
    37.0,
    rotation_between(np.array([0.0, 0.0, 1.0]), np.array([0.3, -0.8, 0.2])),
    np.array([5.0, -3.0, 11.0]),
)
"""sfm_from_table: an arbitrary frame, as reconstructions have it."""


def write_scene(
    folder: Path,
    points: Array,
    tags: dict | None = None,
    sfm_from_table: Similarity = AWAY,
    poses: list[Array] = POSES,
    noise: float = 0.3,
) -> dict[str, Path]:
    """Files of the sfm stage for given truth."""
    model = moved(model_of(PINHOLE, poses, points, noise=noise), sfm_from_table)
    (folder / "model").mkdir(parents=True)
    model.write_binary(folder / "model")
    splits = {name: split_of(i) for i, name in enumerate(names(len(poses)))}
    write_json(folder / "sfm.json", {"camera": PINHOLE.to_json(), "splits": splits})
    write_json(folder / "tags.json", tags or {})
    return {
        "sfm_json": folder / "sfm.json",
        "model": folder / "model",
        "tags": folder / "tags.json",
        "out_json": folder / "align" / "align.json",
        "out_views": folder / "align" / "views.json",
        "out_points": folder / "align" / "points.npz",
    }


def run(
    paths: dict[str, Path],
    settings: AlignSettings | None = None,
    board: bool = True,
    known_length: dict | None = None,
    **more: object,
) -> dict:
    align_scene(
        **paths, settings=settings or AlignSettings(), board=BOARD if board else None, known_length=known_length, seed=0, **more
    )
    return json.loads(paths["out_json"].read_text())


def centres(paths: dict[str, Path]) -> Array:
    views = json.loads(paths["out_views"].read_text())["views"]
    return np.array([camera_centre(np.array(view["cam_from_table"])) for view in views])


TRUE_CENTRES = np.array([camera_centre(pose) for pose in POSES])


def test_board_gives_the_table_frame(tmp_path: Path) -> None:
    paths = write_scene(tmp_path, cloud(), sightings(PINHOLE, POSES, noise=0.1))
    record = run(paths)
    assert record["status"] == "pass"
    assert record["scale_source"] == "tags"
    assert record["tags"] == 8
    assert record["scale"] * AWAY.scale == pytest.approx(1.0, abs=5e-4)
    assert np.linalg.norm(centres(paths) - TRUE_CENTRES, axis=1).max() < 5e-4
    assert record["tilt_deg"] < 0.1
    assert abs(record["height_mm"]) < 0.3
    matrix = Similarity.from_matrix(np.array(record["table_from_sfm"])).compose(AWAY)
    assert np.rad2deg(rotation_angle(matrix.rotation)) < 0.05
    points = np.load(paths["out_points"])
    flat = np.abs(points["points"][:, 2]) < 0.002
    assert flat.sum() > 400
    views = json.loads(paths["out_views"].read_text())["views"]
    assert [view["split"] for view in views] == [split_of(i) for i in range(24)]


def test_visibility_lists_name_points_that_the_view_sees(tmp_path: Path) -> None:
    paths = write_scene(tmp_path, cloud(), sightings(PINHOLE, POSES), noise=0.0)
    run(paths)
    points = np.load(paths["out_points"])
    views = json.loads(paths["out_views"].read_text())["views"]
    for index in (0, 7, 23):
        seen = points["points"][points["point_index"][points["view_index"] == index]]
        camera = Camera.from_json(views[index]["camera"])
        pixels = camera.project(local(np.array(views[index]["cam_from_table"]), seen))
        assert len(seen) > 50
        assert ((pixels > -1) & (pixels < [641, 481])).all()


def test_scale_error_is_of_the_size_it_says() -> None:
    """The scatter of the scale over repeated noise against the standard error from one capture."""
    poses = {name: (PINHOLE, pose) for name, pose in zip(names(12), orbit(12), strict=True)}
    fits = [fit_board(sightings(PINHOLE, orbit(12), noise=0.5, seed=k), poses, BOARD, 0) for k in range(12)]
    scatter = np.std([fit.board_from_sfm.scale for fit in fits if fit is not None], ddof=1)
    stated = np.median([fit.scale_se for fit in fits if fit is not None])
    # Resampling eight tags and a dozen repetitions know it to a factor of two or so.
    assert 0.3 < stated / scatter < 4.0


def test_a_misread_tag_does_not_move_the_frame() -> None:
    tags = sightings(PINHOLE, POSES, noise=0.1)
    for found in tags.values():
        if 2 in found:
            found[2] = found[2] + [0.0, 9.0]
    poses = {name: (PINHOLE, pose) for name, pose in zip(names(24), POSES, strict=True)}
    fit = fit_board(tags, poses, BOARD, 0)
    assert fit is not None
    assert fit.board_from_sfm.scale == pytest.approx(1.0, abs=0.002)
    assert np.linalg.norm(fit.board_from_sfm.translation) < 1.5e-3


def test_two_tags_are_no_board() -> None:
    tags = {name: {k: v for k, v in found.items() if k < 2} for name, found in sightings(PINHOLE, POSES).items()}
    poses = {name: (PINHOLE, pose) for name, pose in zip(names(24), POSES, strict=True)}
    assert fit_board(tags, poses, BOARD, 0) is None


def test_tilted_board_is_told(tmp_path: Path) -> None:
    lean = rotation_between(np.array([0.0, 0.0, 1.0]), np.array([np.sin(0.05), 0.0, np.cos(0.05)]))
    table = cloud() @ lean.T
    record = run(write_scene(tmp_path, table, sightings(PINHOLE, POSES)))
    assert record["status"] == "degraded"
    assert record["tilt_deg"] == pytest.approx(np.rad2deg(0.05), abs=0.2)
    assert "lay it flat" in record["reasons"][0]


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e4])
def test_plane_does_not_depend_on_the_unit(unit: float) -> None:
    frame = Similarity(unit, AWAY.rotation, unit * AWAY.translation)
    looks = attention(frame.move_pose(np.array(POSES)))
    plane = find_table(frame.apply(cloud()), looks, threshold=0.006, seed=0)
    assert plane is not None
    up = AWAY.rotation @ np.array([0.0, 0.0, 1.0])
    assert np.rad2deg(np.arccos(min(1.0, up @ plane.normal))) < 0.1
    assert plane.heights(frame.apply(np.zeros(3))) / unit == pytest.approx(0.0, abs=1e-4)


def test_plane_is_the_one_under_the_object_not_the_largest() -> None:
    rng = np.random.default_rng(2)
    # A wall behind, a floor below and a box on a small table; wall and floor have three times the table's points.
    wall = np.c_[rng.uniform(-1.5, 1.5, 1500), np.full(1500, 1.2), rng.uniform(-0.7, 1.0, 1500)]
    floor = np.c_[rng.uniform(-1.5, 1.5, (1500, 2)), np.full(1500, -0.7)]
    far = (np.abs(floor[:, :2]) > 0.5).any(1)
    points = np.r_[cloud(on_table=500), wall, floor[far]]
    plane = find_table(points, attention(np.array(POSES)), threshold=0.006, seed=0)
    assert plane is not None
    assert plane.normal[2] > 0.9999
    assert abs(plane.offset) < 5e-4


def test_plane_is_not_the_top_of_the_object() -> None:
    rng = np.random.default_rng(3)
    top = np.c_[rng.uniform(-0.1, 0.1, (900, 2)), np.full(900, 0.08)]
    plane = find_table(np.r_[cloud(on_table=500, above=0), top], attention(np.array(POSES)), threshold=0.006, seed=0)
    assert plane is not None
    assert abs(plane.offset) < 1e-3


def test_normal_points_to_the_cameras() -> None:
    flip = Similarity(1.0, np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    plane = find_table(flip.apply(cloud()), attention(flip.move_pose(np.array(POSES))), threshold=0.006, seed=0)
    assert plane is not None
    assert plane.normal[2] < -0.999


def test_object_is_found_above_the_plane() -> None:
    points = cloud()
    looks = attention(np.array(POSES))
    plane = find_table(points, looks, threshold=0.006, seed=0)
    assert plane is not None
    found = object_points(points, plane, looks)
    assert (found >= 600).sum() > 0.9 * 200
    assert (found >= 600).all()


def test_without_a_board_the_scale_is_said_to_be_unknown(tmp_path: Path) -> None:
    shifted = cloud() + np.array([0.02, -0.03, 0.0])
    paths = write_scene(tmp_path, shifted)
    record = run(paths, board=False)
    assert record["status"] == "degraded"
    assert record["scale_source"] == "unknown"
    assert "unknown" in record["reasons"][0]
    assert 0.1 <= max(record["object_extent"]) < 0.115
    points = np.load(paths["out_points"])["points"]
    # The box stands over the origin, on the table, z up.
    box = points[points[:, 2] > 0.02]
    np.testing.assert_allclose(np.median(box[:, :2], axis=0), 0.0, atol=0.01)
    assert np.abs(np.median(points[:, 2])) < 1e-3
    assert (centres(paths)[:, 2] > 0.1).all()


def test_single_points_do_not_decide_the_unit_of_an_unknown_scale() -> None:
    rng = np.random.default_rng(0)
    body = rng.uniform([-0.05, -0.03, 0.0], [0.05, 0.03, 0.06], (400, 3))
    c, s = np.cos(0.5), np.sin(0.5)
    body = body @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    stray = np.array([[0.06, 0.02, 0.02], [-0.06, -0.03, 0.01]])
    alone, joined = (box_sides(points, 1.0) for points in (body, np.concatenate([body, stray])))
    assert joined.max() == pytest.approx(alone.max(), rel=0.02)
    assert alone.max() == pytest.approx(0.1, rel=0.05)
    assert np.abs(box_sides(np.concatenate([body, stray])).max() / box_sides(body).max() - 1) > 0.05


def test_length_of_the_object_gives_the_scale(tmp_path: Path) -> None:
    paths = write_scene(tmp_path, cloud(above=2000))
    record = run(paths, board=False, known_length={"metres": 0.06, "object": "longest"})
    assert record["status"] == "degraded"
    assert any("longest side" in reason for reason in record["reasons"])
    assert record["scale_source"] == "known_length"
    # Stragglers are cut from the extent on both sides.
    assert record["scale"] * AWAY.scale == pytest.approx(1.0, abs=0.06)


def test_two_points_on_the_table_give_the_scale(tmp_path: Path) -> None:
    paths = write_scene(tmp_path, cloud())
    ends = [(0, np.array([0.1, 0.05, 0.0])), (9, np.array([-0.08, 0.02, 0.0]))]
    pixels = [[names(24)[i], *PINHOLE.project(local(POSES[i], point))] for i, point in ends]
    metres = float(np.linalg.norm(ends[0][1] - ends[1][1]))
    record = run(paths, board=False, known_length={"metres": metres, "between": pixels})
    assert record["scale"] * AWAY.scale == pytest.approx(1.0, abs=0.003)
    assert np.ptp(np.linalg.norm(centres(paths), axis=1)) == pytest.approx(
        np.ptp(np.linalg.norm(TRUE_CENTRES, axis=1)), abs=0.03
    )


def between(metres: float, *ends: tuple[int, float, float]) -> dict:
    """Two places on the table as somebody reads them off keyframes."""
    pixels = [[names(24)[i], *PINHOLE.project(local(POSES[i], np.array([x, y, 0.0])))] for i, x, y in ends]
    return {"metres": metres, "between": pixels}


def test_a_length_between_near_points_is_in_doubt_and_pixels_outside_a_photo_are_refused(tmp_path: Path) -> None:
    paths = write_scene(tmp_path, cloud())
    far = run(paths, board=False, known_length=between(0.2, (3, 0.1, 0.0), (3, -0.1, 0.0)))
    near = run(paths, board=False, known_length=between(0.01, (3, 0.005, 0.0), (3, -0.005, 0.0)))
    assert far["status"] == "pass"
    assert 0 < far["scale_se"] < 0.01 * far["scale"]
    assert any("farther apart" in reason for reason in near["reasons"])
    # Twenty times as near, twenty times as unsure.
    assert near["scale_se"] / far["scale_se"] == pytest.approx(20, rel=0.1)
    big = between(0.2, (3, 0.1, 0.0), (3, -0.1, 0.0))
    big["between"][1][1:] = [2.5 * value for value in big["between"][1][1:]]
    with pytest.raises(InputError, match="lies outside 0003"):
        run(paths, board=False, known_length=big)


def test_a_known_length_that_contradicts_the_board_is_told(tmp_path: Path) -> None:
    paths = write_scene(tmp_path, cloud(), sightings(PINHOLE, POSES, noise=0.1))
    ends = (3, 0.1, 0.0), (9, -0.1, 0.0)
    assert not any("known_length" in reason for reason in run(paths, known_length=between(0.2, *ends))["reasons"])
    record = run(paths, known_length=between(0.188, *ends))
    assert any("makes lengths 94 % of what the board makes them" in reason for reason in record["reasons"])


def test_table_point_is_where_the_lens_sees_it() -> None:
    point = np.array([0.07, -0.04, 0.0])
    pixel = LENS.project(local(POSES[5], point))
    np.testing.assert_allclose(table_point(pixel, LENS, POSES[5]), point, atol=1e-6)
    # A level camera sees no table above its horizon.
    level = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.3], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    assert np.isnan(table_point(np.array([320.0, 10.0]), PINHOLE, level)).all()


@pytest.mark.parametrize(
    "setting",
    [
        {"metres": 0.1},
        {"metres": "long", "object": "longest"},
        {"metres": -1.0, "object": "longest"},
        {"metres": 0.1, "between": [["a.png", 1, 2]]},
        {"object": "longest"},
    ],
)
def test_unreadable_length_is_refused(setting: dict) -> None:
    with pytest.raises(InputError, match="known_length: "):
        KnownLength.parse(setting)


def test_length_in_a_missing_keyframe_is_refused(tmp_path: Path) -> None:
    paths = write_scene(tmp_path, cloud())
    with pytest.raises(InputError, match=r"nine\.png is not registered"):
        run(paths, board=False, known_length={"metres": 0.1, "between": [["nine.png", 1, 2], ["0000.png", 3, 4]]})


@pytest.mark.parametrize("board", [False, True])
def test_required_scale_without_a_board_stops(tmp_path: Path, board: bool) -> None:
    paths = write_scene(tmp_path, cloud())
    with pytest.raises(StageError, match=r"the scale is required.*known_length"):
        run(paths, AlignSettings(require_scale=True), board=board)
    assert not paths["out_json"].exists()
    assert not paths["out_points"].exists()


def test_no_table_stops(tmp_path: Path) -> None:
    ball = np.random.default_rng(0).normal(0, 0.05, (300, 3))
    paths = write_scene(tmp_path, ball[np.linalg.norm(ball, axis=1) > 0.08][:15])
    with pytest.raises(StageError, match="no table plane"):
        run(paths, board=False)


def test_record_of_another_model_is_refused(tmp_path: Path) -> None:
    paths = write_scene(tmp_path, cloud())
    write_json(paths["sfm_json"], {"camera": PINHOLE.to_json(), "splits": {}})
    with pytest.raises(InputError, match=r"sfm\.json"):
        run(paths, board=False)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_the_table_is_found_in_photos_that_lie_on_their_side_or_head(quarters: int) -> None:
    angle = quarters * np.pi / 2
    turn = np.eye(4)
    turn[:2, :2] = np.round([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    looks = attention(turn @ np.array(POSES))
    plane = find_table(cloud(), looks, threshold=0.006, seed=0)
    assert plane is not None
    assert plane.normal[2] > 0.9999
    assert abs(plane.offset) < 5e-4
    side = {1: "right", 2: "bottom", 3: "left"}[quarters]
    assert attention(turn @ np.array(POSES), side).up[2] == pytest.approx(attention(np.array(POSES)).up[2])


def test_the_table_is_found_from_straight_above() -> None:
    poses = []
    for index in range(12):
        angle = 2 * np.pi * index / 12
        eye = np.array([0.03 * np.cos(angle), 0.03 * np.sin(angle), 0.5])
        spin = np.eye(4)
        spin[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        poses.append(spin @ look_at(eye, np.array([0.0, 0.0, 0.01])))
    plane = find_table(cloud(), attention(np.array(poses)), threshold=0.006, seed=0)
    assert plane is not None
    assert plane.normal[2] > 0.9999


def test_a_named_side_refuses_the_table_that_lies_against_it_and_says_so(tmp_path: Path) -> None:
    paths = write_scene(tmp_path, cloud())
    with pytest.raises(StageError, match=r"no table plane among .*does not face the side that `up` names"):
        run(paths, board=False, up="bottom")
    assert run(paths, board=False, up="top")["scale_source"] == "unknown"


def test_a_wide_foot_belongs_to_the_object_and_bumps_of_the_table_do_not() -> None:
    rng = np.random.default_rng(4)
    body = rng.uniform([-0.012, -0.012, 0.02], [0.012, 0.012, 0.1], (300, 3))
    plinth = np.c_[rng.uniform(-0.045, 0.045, (1500, 2)), rng.uniform(0.006, 0.02, 1500)]
    table = np.c_[rng.uniform(-0.3, 0.3, (3000, 2)), rng.normal(0, 2e-4, 3000)]
    table = table[np.abs(table[:, :2]).max(1) > 0.045]
    bumps = np.c_[rng.uniform(0.1, 0.2, (200, 2)), rng.uniform(0.005, 0.01, 200)]
    points = np.concatenate([body, plinth, table, bumps])
    found = find_standing(points, np.array([0.0, 0.0, 0.02]), 0.45).members
    assert (found < 300).sum() > 290
    assert ((found >= 300) & (found < 1800)).sum() > 0.95 * 1500
    assert (found >= 1800 + len(table)).sum() == 0
    assert ((found >= 1800) & (found < 1800 + len(table))).sum() == 0


def test_metric_poses_give_the_scale_and_the_board_is_compared_with_it(tmp_path: Path) -> None:
    paths = write_scene(tmp_path / "a", cloud())
    record = run(paths, board=False, metres_per_unit=1 / AWAY.scale)
    assert record["scale_source"] == "poses"
    assert record["scale"] * AWAY.scale == pytest.approx(1.0)
    assert not any("scale" in reason for reason in record["reasons"])
    doubted = run(write_scene(tmp_path / "b", cloud(), sightings(PINHOLE, POSES)), metres_per_unit=1.1 / AWAY.scale)
    assert doubted["scale_source"] == "tags"
    assert any("metres_per_unit" in reason for reason in doubted["reasons"])


@pytest.mark.parametrize(("beside", "taken", "told"), [(0, "mug", False), (300, "mug", False), (900, "box", True)])
def test_a_neighbour_with_more_texture_is_not_taken_in_silence(beside: int, taken: str, told: bool) -> None:
    """A plain mug where the cameras look, a printed box 12 cm aside."""
    rng = np.random.default_rng(3)
    mug = rng.uniform([-0.04, -0.04, 0.0], [0.04, 0.04, 0.1], (150, 3))
    box = rng.uniform([0.09, -0.03, 0.0], [0.15, 0.03, 0.1], (beside, 3))
    table = np.c_[rng.uniform(-0.4, 0.4, (2000, 2)), rng.normal(0, 2e-4, 2000)]
    found = find_standing(np.concatenate([mug, box, table]), np.array([0.0, 0.0, 0.04]), 0.5)
    inside = (found.members < 150).mean()
    assert inside > 0.95 if taken == "mug" else inside < 0.05
    assert (found.nearer > 20) == told
