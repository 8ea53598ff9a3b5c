"""Renderers: one interface, occlusion, movement, coverage, colours; the robot's splats on disk."""

import numpy as np
import pytest
import trimesh
from robot_fixture import kinematics, robot

from gsbridge.cameras import look_at
from gsbridge.environment.gaussian_renderer import GaussianRenderer
from gsbridge.environment.mesh_renderer import MeshRenderer, mean_mesh_colour
from gsbridge.environment.rendering import FIELD_OF_VIEW, Renderer, wrist_camera
from gsbridge.environment.robot_splats import link_meshes, read_robot_splats, robot_splats, write_robot_splats
from gsbridge.errors import InputError
from gsbridge.meshes import Mesh
from gsbridge.robot.nominal import base_from_table
from gsbridge.scene.light import SkyLight, directions
from gsbridge.scene.link_splats import splats_on_mesh
from gsbridge.scene.shadows import Shadows
from gsbridge.scene.view import draw_seen

EDGE = 0.06
RED, BLUE = (0.8, 0.1, 0.1), (0.1, 0.2, 0.7)
CAMERA = wrist_camera(64)


def shape(solid: trimesh.Trimesh, colour, shift=(0, 0, 0)) -> Mesh:
    vertices = np.asarray(solid.vertices, float) + shift
    return Mesh(vertices, np.asarray(solid.faces, np.int64), np.tile(np.float32(colour), (len(vertices), 1)))


CUBE = shape(trimesh.creation.box((EDGE, EDGE, EDGE)), RED, (0, 0, EDGE / 2))
TABLE = shape(trimesh.creation.box((1.0, 1.0, 0.002)), BLUE, (0, 0.265, -0.001))


@pytest.fixture(scope="module")
def links():
    return robot_splats(robot(), 900, fit_steps=0, seed=1)


@pytest.fixture(scope="module")
def renderers(links):
    cube, table = splats_on_mesh(CUBE, 600), splats_on_mesh(TABLE, 2500)
    meshes = link_meshes(robot())
    return {
        "gs": GaussianRenderer(cube, table, links, CAMERA, surface=None),
        "mesh": MeshRenderer(CUBE, TABLE, meshes, CAMERA),
        "mesh_vertex": MeshRenderer(CUBE, TABLE, meshes, CAMERA, vertex_colours=True),
    }


def poses(x: float, y: float, aperture: float = 0.1):
    """Robot in its rest posture, cube somewhere on the table; and the wrist camera."""
    chain = kinematics()
    q = np.append(chain.rest, robot().dimensions.open_angle)
    table_from_base = np.linalg.inv(base_from_table())
    out = {name: table_from_base @ pose for name, pose in chain.fk(q).items()}
    out["object"] = np.eye(4)
    out["object"][:3, 3] = x, y, 0.0
    return out, np.linalg.inv(out["camera"])


def test_all_renderers_show_the_same_scene(renderers):
    where, view = poses(0.03, 0.25)
    images = {name: renderer.render(where, view) for name, renderer in renderers.items()}
    for name, renderer in renderers.items():
        assert isinstance(renderer, Renderer)
        assert images[name].shape == (64, 64, 3)
        assert images[name].dtype == np.uint8
        assert renderer.coverage(where, view) > 0.995
    # Same poses, same silhouettes: colours differ at edges only, which splats blur.
    differs = np.abs(images["gs"].astype(int) - images["mesh"]).max(-1) > 40
    assert differs.mean() < 0.08
    np.testing.assert_array_equal(images["mesh"], images["mesh_vertex"])


def test_the_picture_before_rounding_is_that_of_the_bytes(renderers):
    where, view = poses(0.03, 0.25)
    for renderer in renderers.values():
        drawn, image = renderer.draw(where, view), renderer.render(where, view)
        assert drawn.dtype == np.float32
        # Half a level, and what float32 loses in the mean of four samples.
        assert np.abs(255 * np.clip(drawn, 0, 1).astype(np.float64) - image).max() < 0.5 + 1e-4


def test_what_is_small_in_the_picture_keeps_its_size():
    """A ball of eleven pixels, of many splats, against its outline; splats as wide as a pixel make it half as large again."""
    ball = splats_on_mesh(shape(trimesh.creation.icosphere(4, 0.03), RED), 2000)
    renderer = GaussianRenderer(ball, ball.subset(np.zeros(0, int)), {}, CAMERA, backdrop=BLUE)
    here, view = {"object": np.eye(4)}, look_at((0.0, 0.0, 0.45), (0.0, 0.01, 0.0))
    alphas = renderer.shot(here, view).alphas
    # The cone that touches the ball.
    outline = np.pi * CAMERA.fx**2 * 0.03**2 / (0.45**2 - 0.03**2)
    assert alphas.sum() == pytest.approx(outline, rel=0.12)
    assert alphas.max() > 0.98
    _, widened, _ = draw_seen(renderer.composition.splats, renderer.composition.see(here, CAMERA, view), CAMERA, BLUE, 1)
    assert widened.sum() > 1.4 * outline


def test_cube_appears_where_the_camera_projects_it(renderers, links):
    """Red pixels' middle against the pinhole's own projection of the cube's middle."""
    for name, renderer in renderers.items():
        for x, y in ((0.05, 0.22), (-0.02, 0.31)):
            where, _ = poses(x, y)
            view = look_at((0.1, 0.1, 0.6), (0.0, 0.265, 0.0))
            bare = {**where, **{link: where[link] + 5.0 * np.eye(4, k=3) for link in links}}
            image = renderer.render(bare, view).astype(float)
            red = (image[..., 0] > image[..., 2] + 60).nonzero()
            middle = np.array([red[1].mean(), red[0].mean()]) + 0.5
            point = view @ [x, y, EDGE / 2, 1]
            expected = [CAMERA.fx * point[0] / point[2] + CAMERA.cx, CAMERA.fy * point[1] / point[2] + CAMERA.cy]
            np.testing.assert_allclose(middle, expected, atol=1.0, err_msg=name)


def test_hand_hides_the_cube(renderers):
    view = look_at((0.0, 0.265, 0.8), (0.0, 0.2651, 0.0))
    where, _ = poses(0.0, 0.265)
    for renderer in renderers.values():
        image = renderer.render(where, view)
        # Red, not the orange of the arm.
        assert not ((image[..., 0] > 150) & (image[..., 1] < 60)).any()
        gone = {name: pose if name == "object" else pose + 5.0 * np.eye(4, k=3) for name, pose in where.items()}
        image = renderer.render(gone, view)
        assert ((image[..., 0] > 150) & (image[..., 1] < 60)).any()


def test_still_scene_is_drawn_alike_and_poses_are_needed(renderers):
    where, view = poses(0.0, 0.265)
    for renderer in renderers.values():
        first = renderer.render(where, view)
        renderer.render(*poses(0.1, 0.2))
        np.testing.assert_array_equal(renderer.render(where, view), first)
        with pytest.raises(InputError, match="left_pad"):
            renderer.render({name: pose for name, pose in where.items() if name != "left_pad"}, view)


def test_mesh_colours():
    two = Mesh(CUBE.vertices, CUBE.faces, np.where(CUBE.vertices[:, 2:] > 0.03, [1.0, 1, 1], [0.0, 0, 0]).astype(np.float32))
    # Top white, foot black, sides half and half: half the light, which is 0.735 in sRGB.
    np.testing.assert_allclose(mean_mesh_colour(two), 0.7354, atol=0.01)
    where, view = poses(0.05, 0.22)
    green = MeshRenderer(CUBE, TABLE, link_meshes(robot()), CAMERA, item_colour=(0, 1, 0), background_colour=(0, 0, 0))
    image = green.render(where, view)
    assert (image[..., 1] > 250).any()
    assert (image.sum(-1) == 0).any()
    with pytest.raises(InputError, match="no vertex colours"):
        MeshRenderer(Mesh(CUBE.vertices, CUBE.faces), TABLE, {}, CAMERA)


def test_robot_splats_are_the_description_s_and_survive_the_disk(links, tmp_path):
    meshes = link_meshes(robot())
    assert set(links) == set(meshes) == set(robot().record["visuals"])
    assert 850 <= sum(map(len, links.values())) <= 900
    arm = sum(len(links[name]) for name in robot().record["arm_links"] if name in links)
    assert arm < 0.4 * 900
    for name, cloud in links.items():
        low, high = meshes[name].vertices.min(0), meshes[name].vertices.max(0)
        assert ((cloud.means > low - 0.01) & (cloud.means < high + 0.01)).all()
        allowed = {tuple(colour) for colour in np.unique(meshes[name].colours, axis=0).tolist()}
        assert {tuple(colour) for colour in cloud.colours.tolist()} <= allowed
    write_robot_splats(tmp_path / "links", links)
    back = read_robot_splats(tmp_path / "links")
    assert list(back) == list(links)
    for name, cloud in links.items():
        np.testing.assert_array_equal(back[name].means, cloud.means)
        np.testing.assert_allclose(back[name].scales, cloud.scales, rtol=1e-5)
        np.testing.assert_allclose(back[name].colours, cloud.colours, atol=1e-6)
    painted = robot_splats(robot(), 900, colours={"palm": (0.2, 0.3, 0.4)}, fit_steps=0)
    np.testing.assert_allclose(painted["palm"].colours, np.tile(np.float32([0.2, 0.3, 0.4]), (len(painted["palm"]), 1)))


def test_bad_robot_splats_are_refused(links, tmp_path):
    with pytest.raises(InputError, match="no drawn link"):
        robot_splats(robot(), colours={"elbow": (0, 0, 0)})
    with pytest.raises(InputError, match="too few"):
        robot_splats(robot(), 50)
    write_robot_splats(tmp_path / "links", links)
    (tmp_path / "links" / "palm.ply").unlink()
    with pytest.raises(InputError, match=r"palm\.ply"):
        read_robot_splats(tmp_path / "links")
    with pytest.raises(InputError):
        read_robot_splats(tmp_path / "none")
    with pytest.raises(InputError, match="wrist camera"):
        wrist_camera(0)


def test_camera_is_the_mirror_s():
    from gsbridge.reality.world import camera as mirror

    assert mirror.FIELD_OF_VIEW == FIELD_OF_VIEW
    assert mirror.wrist_camera(128) == wrist_camera(128)


def test_meshes_and_splats_stand_in_the_same_shadows(renderers, links):
    """The share of light that is left on the table is the same, whoever draws it; without shadows nothing changes."""
    count = len(directions())
    light = SkyLight(0.2, np.full(count, 0.8 / count))
    spheres = {name: np.array([[0.0, 0.0, 0.0, 0.03]]) for name in link_meshes(robot())}
    shadows = Shadows(light, spheres, ("object", np.array([[0.0, 0.0, EDGE / 2, EDGE / 2]])))
    cube, table = splats_on_mesh(CUBE, 600), splats_on_mesh(TABLE, 2500)
    shaded = {
        "gs": GaussianRenderer(cube, table, links, CAMERA, surface=None, shadows=shadows),
        "mesh": MeshRenderer(CUBE, TABLE, link_meshes(robot()), CAMERA, shadows=shadows),
    }
    where, view = poses(0.03, 0.25)
    plain = {name: renderers[name].render(where, view).astype(float) for name in shaded}
    left = {name: (drawn.render(where, view) + 1.0) / (plain[name] + 1.0) for name, drawn in shaded.items()}
    # The table is blue in both, away from edges that splats blur.
    on_table = np.all([(picture[..., 2] > picture[..., 0] + 100) for picture in plain.values()], axis=0)
    assert on_table.mean() > 0.2
    assert left["mesh"][on_table, 2].min() < 0.95
    assert np.abs(left["gs"] - left["mesh"])[on_table, 2].mean() < 0.02
    assert (left["mesh"] <= 1.0).all()
    everywhere = Shadows(SkyLight(1.0, np.zeros(count)), spheres, ("object", np.zeros((0, 4))))
    lit = MeshRenderer(CUBE, TABLE, link_meshes(robot()), CAMERA, shadows=everywhere)
    # Means of four samples round differently in one value or another.
    np.testing.assert_allclose(lit.render(where, view), plain["mesh"], atol=1)
