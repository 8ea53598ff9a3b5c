"""The onlooker's pictures: hand and object stand where the log says; what was not filmed is drawn plainly."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from robot_fixture import robot
from test_environment_renderers import BLUE, RED, shape
from trial_files import path

from gsbridge.cameras import Camera
from gsbridge.environment.gaussian_renderer import GaussianRenderer
from gsbridge.environment.onlooker import PAPER, STAND, OnlookerView
from gsbridge.environment.robot_splats import robot_splats
from gsbridge.robot.nominal import base_from_table
from gsbridge.scene.link_splats import splats_on_mesh

WIDTH, HEIGHT, EDGE = 320, 240, 0.06
CUBE = shape(trimesh.creation.box((EDGE, EDGE, EDGE)), RED, (0, 0, EDGE / 2))
TABLE = shape(trimesh.creation.box((0.8, 0.8, 0.002)), BLUE, (0, 0, -0.001))


@pytest.fixture(scope="module")
def view():
    camera = Camera(WIDTH, HEIGHT, 1.05 * WIDTH, 1.05 * WIDTH, WIDTH / 2, HEIGHT / 2)
    links = robot_splats(robot(), 900, fit_steps=0, seed=1)
    renderer = GaussianRenderer(splats_on_mesh(CUBE, 600), splats_on_mesh(TABLE, 2500), links, camera, backdrop=PAPER)
    return OnlookerView(robot(), base_from_table(), renderer, None, np.array(BLUE))


def pixel(view, point):
    """Where a point of the table frame is seen."""
    seen = view.cam_from_table @ [*point, 1.0]
    return view.renderer.camera.project(seen[:3])


def test_hand_and_object_stand_where_the_log_says(view):
    trial = path("fixed", 0, 6)
    pictures = view.pictures(trial, 5)
    assert [picture.shape for picture in pictures] == [(HEIGHT, WIDTH, 3)] * 2
    for state, picture in zip((0, 5), pictures, strict=True):
        red = (picture[..., 0] > 110) & (picture[..., 1] < 80)
        centre = trial.object_position[state] + (0.0, 0.0, EDGE / 2)
        assert np.hypot(*(np.argwhere(red).mean(0)[::-1] + 0.5 - pixel(view, centre))) < 8
    # What moved lies round the two places of the tool's point: hand and cube, and above them the arm.
    moved = np.abs(pictures[0].astype(int) - pictures[1]).max(-1) > 40
    for state in (0, 5):
        u, v = np.rint(pixel(view, trial.tool[state] + (0.0, 0.0, 0.03))).astype(int)
        assert moved[v - 8 : v + 8, u - 8 : u + 8].any()


def test_the_arm_that_is_found_holds_the_tool_where_it_was(view, monkeypatch):
    trial, drawn = path("fixed", 0, 6), []
    # Within the arm's reach.
    trial = replace(trial, tool=trial.tool * (0.4, 1.0, 1.0))
    shot = view.renderer.shot
    monkeypatch.setattr(view.renderer, "shot", lambda poses, cam: drawn.append(poses) or shot(poses, cam))
    view.pictures(trial, 1)
    assert len(drawn) == 6
    for state, poses in enumerate(drawn):
        assert np.abs(poses["tool"][:3, 3] - trial.tool[state]).max() < 1e-3
        # It points down, and is turned as the log says.
        assert poses["tool"][2, 2] < -0.999
        assert np.arctan2(poses["tool"][1, 0], poses["tool"][0, 0]) == pytest.approx(trial.tool_yaw[state], abs=0.01)


def test_the_room_is_plain_and_the_arm_has_a_stand(view):
    picture = view.pictures(path("fixed", 0, 2), 1)[0]
    assert np.abs(picture[3, 3] - 255 * np.array(PAPER)).max() < 2
    # The front of the stand, half way down from the arm's foot.
    foot = view.table_from_base @ [0.125, 0.0, 0.0, 1.0]
    u, v = pixel(view, (*foot[:2], foot[2] / 2)).astype(int)
    assert np.abs(picture[v, u] - 255 * np.array(STAND)).max() < 12
