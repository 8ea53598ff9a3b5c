"""The wrist camera's response and the hand's colours, from photos whose response is known."""

import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from robot_fixture import robot

from gsbridge.cameras import Camera
from gsbridge.environment.photometry import calibrate_wrist_camera, fit_response, read_photometry
from gsbridge.environment.robot_splats import link_meshes
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.images import write_image
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.registration.capture import write_arm_table
from gsbridge.robot.kinematics import Kinematics
from gsbridge.robot.nominal import base_from_table, flange_from_camera
from gsbridge.robot.reach import tool_down
from gsbridge.scene.meshes import MeshComposition
from gsbridge.sim.camera import CameraResponse, respond
from gsbridge.sim.model import CameraModel
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.ply import write_ply

TRUE = CameraResponse(gain=0.8, red_gain=1.15, blue_gain=0.9, gamma=1.1, black_level=0.02)
NEUTRAL = CameraModel(1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0)


def test_fit_finds_the_response_through_shadows_and_noise():
    rng = np.random.default_rng(0)
    drawn = rng.uniform(0.05, 0.95, (4000, 3))
    seen = TRUE.apply(drawn) + rng.normal(scale=0.02, size=drawn.shape)
    seen[:400] *= 0.5
    found = fit_response(drawn, seen)
    assert np.abs(found.apply(drawn) - TRUE.apply(drawn)).max() < 0.03
    assert found.red_gain == pytest.approx(TRUE.red_gain, rel=0.03)
    assert found.blue_gain == pytest.approx(TRUE.blue_gain, rel=0.03)


def test_undo_turns_apply_round():
    values = np.random.default_rng(1).uniform(0.1, 0.8, (100, 3))
    np.testing.assert_allclose(TRUE.undo(TRUE.apply(values)), values, atol=1e-9)


def test_the_models_camera_does_the_same():
    """`apply` is what `gsbridge.sim.camera` does with the model's camera; changes of the model come on top."""
    image = np.random.default_rng(2).integers(0, 256, (20, 20, 3), dtype=np.uint8)
    drawn = respond(image, TRUE.after(NEUTRAL), np.random.default_rng(0))
    np.testing.assert_allclose(drawn / 255.0, np.clip(TRUE.apply(image / 255.0), 0, 1), atol=0.003)
    brighter = TRUE.after(CameraModel(2.0, 1.0, 1.0, 1.0, 0.1, 0.0, 0.05))
    assert (brighter.gain, brighter.black_level, brighter.read_noise) == pytest.approx((1.6, 0.12, 0.05))


def table(folder):
    """Asset of a chequered table, as splats and as a mesh; 15 mm squares in three colours."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(-0.6, 0.6, 0.005), np.arange(-0.4, 0.8, 0.005)))
    colours = np.array([[0.8, 0.7, 0.6], [0.2, 0.3, 0.5], [0.5, 0.2, 0.2]])[
        (np.floor(x / 0.05).astype(int) + 2 * np.floor(y / 0.05).astype(int)) % 3
    ]
    means = np.stack([x, y, np.zeros_like(x)], axis=1)
    count = len(means)
    cloud = Cloud(means, np.tile([1.0, 0, 0, 0], (count, 1)), np.tile([0.003, 0.003, 1e-5], (count, 1)),
                  np.full(count, 0.98), colours)  # fmt: skip
    corners = np.array([[-0.6, -0.4, 0], [0.6, -0.4, 0], [0.6, 0.8, 0], [-0.6, 0.8, 0]], float)
    write_ply(folder / "splats.ply", cloud)
    write_mesh(folder / "visual.ply", Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.full((4, 3), 0.5, np.float32)))
    (folder / "body.urdf").write_text("<robot/>")
    write_json(folder / "asset.json", {
        "kind": "background", "body": None, "body_from_table": np.eye(4), "height": 0.0, "width": 1.0,
        "files": {"urdf": "body.urdf", "visual": "visual.ply", "splats": "splats.ply", "hulls": []}})  # fmt: skip
    return cloud


def photographs(folder, cloud, colours):
    """A board capture: the closed hand over the table, the camera's response applied. Drawn by another renderer."""
    kinematics = Kinematics.read(robot().urdf, robot().record["rest_posture"])
    camera = Camera(320, 240, 300.0, 300.0, 160.0, 120.0)
    # The table as a fine mesh with a colour per square, so that the photos do not come from the splats' own renderer.
    square = 0.005
    corners = cloud.means[:, None] + 0.5 * square * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    faces = (4 * np.arange(len(cloud))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    ground = Mesh(corners.reshape(-1, 3), faces, np.repeat(cloud.colours, 4, axis=0).astype(np.float32))
    scene = MeshComposition(link_meshes(robot(), colours), ground)
    names, joints = [], []
    (folder / "capture").mkdir()
    for index, (x, y, yaw) in enumerate([(0.0, 0.2, 0.0), (0.08, 0.25, 0.4), (-0.08, 0.3, -0.5), (0.05, 0.15, 0.9)]):
        found = kinematics.inverse(base_from_table() @ tool_down(np.array([x, y, 0.30]), yaw), kinematics.rest)
        assert found.converged
        q = np.append(found.q, robot().dimensions.angle(0.0))
        poses = {name: np.linalg.inv(base_from_table()) @ pose for name, pose in kinematics.fk(q).items()}
        scene.pose({name: poses[name] for name in scene.names})
        camera_pose = poses["flange"] @ flange_from_camera()
        picture = scene.render(camera, np.linalg.inv(camera_pose))
        names.append(f"{index}.png")
        write_image(folder / "capture" / names[-1], np.clip(TRUE.apply(picture / 255.0), 0, 1).astype(np.float32))
        joints.append(found.q)
    write_arm_table(folder / "capture" / "arm.csv", names, np.array(joints))
    write_json(folder / "registration.json", {
        "base_from_table": base_from_table(), "flange_from_camera": flange_from_camera(), "reasons": [],
        "camera": camera.to_json()})  # fmt: skip


def test_calibration_from_photos_of_a_known_response(tmp_path):
    colours = {"left_pad": (0.3, 0.2, 0.1), "right_pad": (0.1, 0.3, 0.2)}
    photographs(tmp_path, table(tmp_path), colours)
    inputs = {"registration": tmp_path / "registration.json", "robot": robot().folder}
    calibrate_wrist_camera(tmp_path / "out.json", **inputs, capture=tmp_path / "capture", background=tmp_path / "asset.json")
    found, record = read_photometry(tmp_path / "out.json"), read_json(tmp_path / "out.json")
    assert record["status"] == "pass"
    values = np.random.default_rng(3).uniform(0.2, 0.8, (200, 3))
    assert np.abs(found.response.apply(values) - TRUE.apply(values)).max() < 0.02
    # What is left is the squares' edges, which the splats blur.
    assert record["rms_after"] < 0.8 * record["rms_before"]
    for name, colour in colours.items():
        np.testing.assert_allclose(found.robot_colours[name], colour, atol=0.03)


def other_colours(cloud):
    return replace(cloud, colours=np.random.default_rng(0).permutation(cloud.colours))


def aside(cloud):
    return replace(cloud, means=cloud.means + np.array([0.025, 0.0, 0.0]))


def nearly_black(cloud):
    return replace(cloud, colours=0.05 * cloud.colours)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [(other_colours, "was it this table, with the board"), (aside, "does the registration fit"),
     (nearly_black, r"at the limit of what cameras do \(gain 10 and red_gain 3\)")],
)  # fmt: skip
def test_a_fit_to_another_table_is_degraded(tmp_path, wrong, said):
    """The photos are those of a table whose colours are known; its splats are then changed."""
    cloud = table(tmp_path)
    photographs(tmp_path, cloud, {})
    write_ply(tmp_path / "splats.ply", wrong(cloud))
    inputs = {"registration": tmp_path / "registration.json", "robot": robot().folder}
    calibrate_wrist_camera(tmp_path / "out.json", **inputs, capture=tmp_path / "capture", background=tmp_path / "asset.json")
    record = read_json(tmp_path / "out.json")
    assert record["status"] == "degraded"
    assert re.search(said, " ".join(record["reasons"]))


def test_without_photos_or_table_it_is_neutral_and_says_so(tmp_path):
    write_json(tmp_path / "registration.json", {})
    inputs = {"registration": tmp_path / "registration.json", "robot": tmp_path}
    for given in ({"background": "asset.json"}, {"capture": "capture"}):
        calibrate_wrist_camera(tmp_path / "out.json", **inputs, **given)
        record = read_json(tmp_path / "out.json")
        assert record["status"] == "degraded"
        assert "not calibrated" in record["reasons"][0]
        assert asdict(read_photometry(tmp_path / "out.json").response) == asdict(CameraResponse())


def test_damage_and_empty_tables_are_refused(tmp_path):
    write_json(tmp_path / "out.json", {"response": {"gain": 1.0, "grain": 2.0}, "robot_colours": {}})
    with pytest.raises(InputError, match="photometry is damaged"):
        read_photometry(tmp_path / "out.json")
    with pytest.raises(InputError, match="only 3 pixels"):
        fit_response(np.full((3, 3), 0.5), np.full((3, 3), 0.5))
