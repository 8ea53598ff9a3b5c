"""The mirror as one world: physics and camera agree."""

import numpy as np
import pytest
from robot_fixture import robot

from gsbridge.reality.world import camera as module
from gsbridge.reality.world.camera import Quality, Setting, wrist_camera
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.mirror import build_mirror
from gsbridge.robot.nominal import base_from_table
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
