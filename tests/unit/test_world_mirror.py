"""The mirror as one world: physics and camera agree."""

from types import SimpleNamespace

import numpy as np
import pytest
from robot_fixture import kinematics, robot

from gsbridge.files import read_json
from gsbridge.images import read_image_u8
from gsbridge.reality.world import camera as module
from gsbridge.reality.world import views
from gsbridge.reality.world.bodies import true_from_body
from gsbridge.reality.world.camera import Quality, Setting, wrist_camera
from gsbridge.reality.world.episode import photograph_episode
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.mirror import build_mirror
from gsbridge.reality.world.views import SensorExposure, photograph_states
from gsbridge.robot.nominal import base_from_table
from gsbridge.tasks.views import ViewState, write_states
from gsbridge.tasks.world import SeeingWorld


def test_physics_and_camera_are_one_world(tmp_path, monkeypatch):
    # Painting the true table takes longer than the rest together.
    monkeypatch.setattr(module, "table_texture", lambda background, seed: np.full((10, 12, 3), 0.25, np.float32))
    world = build_mirror(
        Setting("small_cube", sheet=None), robot(), base_from_table(), Hidden.draw(2), pieces=tmp_path, quality=Quality(1, 2)
    )
    assert isinstance(world, SeeingWorld)
    world.reset([0.02, 0.25, 0.3], 1)
    first = world.image(32)
    assert first.shape == (32, 32, 3)
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(first, world.image(32))
    world.command([0.02, 0.25, 0.15], 0.0, 0.14)
    for _ in range(8):
        world.step()
    assert (world.image(32) != first).any()
    # The object grows as the camera comes down; both come from the physics' own poses.
    camera = wrist_camera(32)
    near = world.camera.coverage(camera, world.camera_pose(), ("object",)).sum()
    world.reset([0.02, 0.25, 0.3], 1)
    np.testing.assert_array_equal(world.image(32), first)
    far = world.camera.coverage(camera, world.camera_pose(), ("object",)).sum()
    assert near > 1.3 * far > 10
    assert world.state().object_contact[0] == pytest.approx(world.physics.body.mass * 9.81, rel=0.05)


def test_an_episode_is_photographed_at_every_second_state_and_the_last(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "table_texture", lambda background, seed: np.full((10, 12, 3), 0.25, np.float32))
    rest = kinematics().rest
    poses = np.tile(np.eye(4), (6, 1, 1))
    # Still at first, then lifted.
    poses[:, :3, 3] = [[0.0, 0.265, height] for height in (0.0, 0.0, 0.0, 0.03, 0.06, 0.09)]
    states = [ViewState(rest, 0.1, pose, 0, step) for step, pose in enumerate(poses)]
    write_states(tmp_path / "states.json", states, "fixed")
    photograph_episode(
        tmp_path / "states.json", Setting("small_cube", sheet=None), 2, tmp_path / "mirror", tmp_path / "mirror.json",
        SensorExposure(tmp_path / "pieces", 32, 36), every=2,
    )  # fmt: skip
    names = sorted(path.name for path in (tmp_path / "mirror").iterdir())
    assert names == ["0000.png", "0002.png", "0004.png", "0005.png"]
    assert read_json(tmp_path / "mirror.json")["every"] == 2
    first, still, lifted, _ = (read_image_u8(tmp_path / "mirror" / name).astype(int) for name in names)
    # Each photo has noise of its own, which is small beside a move of the object.
    assert (still != first).any()
    moved = [int((np.abs(photo - first).max(2) > 40).sum()) for photo in (still, lifted)]
    assert moved[0] < 0.1 * moved[1]


def test_the_true_object_is_put_where_the_reconstructed_one_stands(tmp_path, monkeypatch):
    """A reconstruction whose frame lies 30 mm beside the true object's: the photo shows it 30 mm aside, to the other side."""
    monkeypatch.setattr(module, "table_texture", lambda background, seed: np.full((10, 12, 3), 0.25, np.float32))
    true = true_from_body("small_cube", 0, np.eye(4))
    beside = np.eye(4)
    beside[0, 3] = 0.03
    write_states(tmp_path / "states.json", [ViewState(kinematics().rest, 0.1, np.array([0.0, 0.265, 0.0]), 0, 0)], "fixed")
    middles = []
    for name, body_from_table in (("same", true), ("beside", beside @ true)):
        # Of an asset, only its frame is asked for.
        monkeypatch.setattr(views, "read_asset", lambda path, pose=body_from_table: SimpleNamespace(body_from_table=pose))
        exposure = SensorExposure(tmp_path / "pieces", 64, 36, item="asset.json")
        photograph_states(
            tmp_path / "states.json", Setting("small_cube", sheet=None), 2, tmp_path / name, tmp_path / f"{name}.json", exposure
        )
        picture = read_image_u8(tmp_path / name / "00.png").astype(float)
        red = (picture[..., 0] > 2.0 * picture[..., 2]) & (picture[..., 0] > 90)
        assert red.sum() > 30
        middles.append(np.argwhere(red).mean(0))
    assert np.linalg.norm(middles[1] - middles[0]) > 4.0
