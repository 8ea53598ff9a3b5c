"""The mirror's board capture: hidden places, planned poses, pictures where projection says."""

import json

import numpy as np
import pytest
from robot_fixture import kinematics

from gsbridge.configuration.films import BoardFilmSettings
from gsbridge.errors import InputError, StageError
from gsbridge.images import read_image_u8
from gsbridge.photogrammetry.board import find_tags, standard_board
from gsbridge.reality.world import camera as world_camera
from gsbridge.reality.world.board_capture import film_board, full_camera
from gsbridge.reality.world.camera import wrist_camera
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table, true_flange_from_camera
from gsbridge.registration.capture import read_board_capture
from gsbridge.registration.handeye import turn_spread_deg
from gsbridge.registration.plan import plan_poses
from gsbridge.registration.result import pose_error
from gsbridge.robot.nominal import base_from_table, flange_from_camera

BOARD = standard_board()


def test_places_are_hidden_within_their_ranges():
    assert pose_error(true_base_from_table(Hidden()), base_from_table()) == (0.0, 0.0)
    assert pose_error(true_flange_from_camera(Hidden()), flange_from_camera()) == (0.0, 0.0)
    for seed in range(20):
        hidden = Hidden.draw(seed)
        for true, nominal, shift, turn in (
            (true_base_from_table(hidden), base_from_table(), 0.010, 1.0),
            (true_flange_from_camera(hidden), flange_from_camera(), 0.003, 1.0),
        ):
            far, angle = pose_error(true, nominal)
            assert 0 < far <= np.sqrt(3) * shift
            assert 0 < np.rad2deg(angle) <= np.sqrt(3) * turn
            assert np.abs(true[:3, 3] - nominal[:3, 3]).max() <= shift


def test_the_square_picture_is_the_middle_of_the_whole_one():
    assert full_camera(640, 480).cropped(80, 0, 480, 480) == wrist_camera(480)
    with pytest.raises(InputError, match="no lying picture"):
        full_camera(480, 640)


def test_planned_poses_see_the_board_from_many_sides():
    camera = full_camera(640, 480)
    joints = plan_poses(kinematics(), base_from_table(), flange_from_camera(), camera, BOARD, count=10, seed=1)
    assert joints.shape == (10, 7)
    assert (kinematics().arm_limits.margin(joints) > 0.06).all()
    links = kinematics().fk(joints)
    assert turn_spread_deg(links["flange"])[1] > 10
    corners = np.concatenate(list(BOARD.corners().values()))
    for pose in links["flange"]:
        cam_from_table = np.linalg.inv(pose @ flange_from_camera()) @ base_from_table()
        pixels = camera.project(corners @ cam_from_table[:3, :3].T + cam_from_table[:3, 3])
        assert ((pixels > 10) & (pixels < [630, 470])).all()
    heights = (np.linalg.inv(base_from_table()) @ links["tool"])[:, 2, 3]
    assert heights.min() > 0.06


def test_a_board_out_of_reach_is_said():
    far = base_from_table()
    far[0, 3] += 1.0
    with pytest.raises(StageError, match="0 of 60 tried poses"):
        plan_poses(
            kinematics(), far, flange_from_camera(), full_camera(640, 480), BOARD, count=8, seed=0, tries=60
        )  # fmt: skip


def board_photos(folder, hidden):
    """The mirror's board photos in a world, and corners of the tags where its truth puts them and as seen, px. [4, 2] each."""
    film_board(
        out_capture=folder / "capture", out_truth=folder / "truth.json", board=BOARD, threads=1, seed=3, hidden=hidden,
        settings=BoardFilmSettings(width=480, height=360, spp=4).model_copy(update={"poses": 2}),
    )  # fmt: skip
    capture, truth = read_board_capture(folder / "capture"), json.loads((folder / "truth.json").read_text())
    assert len(capture.images) == 2
    true, seen = [], []
    flanges = kinematics().fk(capture.joints - np.array(hidden.encoder_offset))["flange"]
    for name, flange in zip(capture.images, flanges, strict=True):
        cam_from_table = np.linalg.inv(flange @ np.array(truth["flange_from_camera"])) @ np.array(truth["base_from_table"])
        tags = find_tags(read_image_u8(capture.folder / name), BOARD)
        assert len(tags) >= 4
        for tag, pixels in tags.items():
            true.append(capture.camera.project(BOARD.corners()[tag] @ cam_from_table[:3, :3].T + cam_from_table[:3, 3]))
            seen.append(pixels)
    return capture, true, seen


def test_pictures_show_the_board_where_the_truth_says(tmp_path, monkeypatch):
    monkeypatch.setattr(world_camera, "table_texture", lambda background, seed: np.full((10, 12, 3), 0.25, np.float32))
    capture, true, seen = board_photos(tmp_path, Hidden.draw(3))
    for expected, pixels in zip(true, seen, strict=True):
        assert np.linalg.norm(expected - pixels, axis=1).mean() < 0.6
    # Nothing of the truth lies beside the photos.
    assert sorted(path.name for path in capture.folder.iterdir()) == ["arm.csv", "camera.json", *capture.images]


def test_the_board_is_photographed_by_the_worlds_own_camera_and_encoders(tmp_path, monkeypatch):
    monkeypatch.setattr(world_camera, "table_texture", lambda background, seed: np.full((10, 12, 3), 0.25, np.float32))
    hidden = Hidden.draw(3).changed({"focal_error": 0.03, "encoder_offset": 0.004, "compression": 30.0})
    capture, true, seen = board_photos(tmp_path, hidden)
    middle = (capture.camera.cx, capture.camera.cy)
    far = [np.linalg.norm(pixels - middle, axis=1).sum() for pixels in (np.concatenate(seen), np.concatenate(true))]
    # The intrinsics that lie beside the photos are those of the data sheet, and the arm's angles what it measures.
    assert far[0] / far[1] == pytest.approx(1.03, abs=0.004)
