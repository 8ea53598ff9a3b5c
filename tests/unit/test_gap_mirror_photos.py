"""Photos of the mirror with planted faults: a shadow lies on the surfaces that a pixel shows."""

import numpy as np
import pytest
from robot_fixture import kinematics, robot

from gsbridge.gap.benchmark.image_truth import FINE
from gsbridge.gap.benchmark.mirror_photos import MirrorStudio, PlantedFault
from gsbridge.reality.world import camera as module
from gsbridge.reality.world.camera import Quality, Setting, wrist_camera
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.mirror import build_mirror
from gsbridge.robot.nominal import base_from_table

SIZE = 48


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A camera above a cube, with the lens as it should be."""
    with pytest.MonkeyPatch.context() as patch:
        # Painting the true table takes longer than the rest together.
        patch.setattr(module, "table_texture", lambda background, seed: np.full((10, 12, 3), 0.25, np.float32))
        hidden, pieces = Hidden.draw(2), tmp_path_factory.mktemp("pieces")
        world = build_mirror(
            Setting("small_cube", sheet=None), robot(), base_from_table(), hidden, pieces=pieces, quality=Quality(1, 2)
        )
    world.place(kinematics().rest, 0.1, np.array([0.0, 0.265, 0.0]))
    world.camera.move(world.body_poses())
    return MirrorStudio(world, hidden, SIZE, np.eye(4))


def on_table(rays, pose):
    """Points at which rays of the camera meet the table, by the equation of the plane. [..., 3]."""
    turned, centre = rays @ pose[:3, :3], -pose[:3, :3].T @ pose[:3, 3]
    return centre + turned * (-centre[2] / turned[..., 2])[..., None]


def test_pixels_show_points_of_the_table_or_of_what_stands_on_it(studio):
    pose, wide = studio.world.camera_pose(), studio._wide()
    places = studio.world.camera.seen_points(studio._wide(), pose)
    plane = on_table(wide.pixel_rays(), pose)
    bodies = studio.world.camera.coverage(wide, pose, studio.world.camera.bodies, samples=1) > 0
    # The sample lies anywhere in its pixel.
    pixel = 1.5 * np.linalg.norm(plane[1:, 1:] - plane[:-1, :-1], axis=-1).max()
    bare = (~bodies) & (np.abs(places[..., 2]) < 1e-3)
    assert bare.mean() > 0.3
    assert np.linalg.norm(places - plane, axis=-1)[bare].max() < pixel
    cube = studio.world.camera.coverage(wide, pose, ("object",), samples=1) > 0
    assert cube.sum() > 100
    # The coverage is that of the pixels' middles, so that a few samples at the outline meet the table.
    met = places[cube] - [0.0, 0.265, 0.0]
    assert np.quantile(np.abs(met[:, :2]), 0.95) < 0.04
    assert np.quantile(met[:, 2], 0.5) == pytest.approx(np.quantile(met[:, 2], 0.9), abs=1e-3)
    assert np.quantile(met[:, 2], 0.5) > 0.03


def test_a_shadow_falls_on_an_object_and_not_on_what_is_seen_through_it(studio):
    pose, camera, pad = studio.world.camera_pose(), wrist_camera(SIZE), (studio._wide().width // FINE - SIZE) // 2
    shown = studio.world.camera.coverage(camera, pose, ("object",))
    whole = np.min([np.roll(shown, (down, right), (0, 1)) for down in (-2, 0, 2) for right in (-2, 0, 2)], axis=0) == 1.0
    places = studio.world.camera.seen_points(studio._wide(), pose)[FINE // 2 :: FINE, FINE // 2 :: FINE]
    met = places[pad : pad + SIZE, pad : pad + SIZE]
    apart = np.where(whole, np.linalg.norm((on_table(camera.pixel_rays(), pose) - met)[..., :2], axis=-1), 0.0)
    row, column = np.unravel_index(apart.argmax(), apart.shape)
    assert apart[row, column] > 0.01
    behind = on_table(camera.pixel_rays()[row, column], pose)
    plain = studio._traced(pose, 0)

    def seen(name, place):
        spin = {"px": place[0], "py": place[1], "radius": 0.5 * apart[row, column]}
        return studio._photo(PlantedFault(name, 0.8, spin), plain, pose, 0)[row, column].astype(int)

    bare = seen("", behind)
    assert (seen("shadow", behind) == bare).all()
    # A fifth of the light is left; the camera encodes it as sRGB.
    assert seen("shadow", met[row, column]).max() < 0.6 * bare.max()
