"""The recording of an episode, read back."""

import cv2
import numpy as np
import pytest
from recording_file import read_recording
from robot_fixture import kinematics, robot

from gsbridge.errors import InputError
from gsbridge.files import write_json
from gsbridge.geometry import rotation_from_quat
from gsbridge.images import write_image
from gsbridge.report.recordings import episode as module
from gsbridge.report.recordings.episode import EpisodeFiles, record_episode
from gsbridge.splats.cloud import Cloud
from gsbridge.tasks.episode import Episode, write_episode

STATES, SIZE = 5, 64


def made() -> Episode:
    """The arm turns about its base while an object rises and turns."""
    rng = np.random.default_rng(0)
    joints = np.tile(kinematics().rest, (STATES, 1))
    joints[:, 0] += np.linspace(0, 0.5, STATES)
    bodies = [kinematics().fk(np.append(q, 0.3)) for q in joints]
    rising = np.tile(np.eye(4), (STATES, 1, 1))
    rising[:, :3, :3] = rotation_from_quat(rng.normal(size=(STATES, 4)))
    rising[:, 2, 3] = np.linspace(0, 0.1, STATES)
    return Episode(
        task="grasp",
        start=2,
        start_pose=np.array([0.01, 0.02, 0.0]),
        time=0.05 * np.arange(STATES),
        joints=joints,
        aperture=np.linspace(0.14, 0.06, STATES),
        names=("object", *bodies[0]),
        poses=np.stack([np.stack([lifted, *poses.values()]) for lifted, poses in zip(rising, bodies, strict=True)]),
        cam_from_table=np.stack([np.linalg.inv(poses["camera"]) for poses in bodies]),
        forces=rng.uniform(0, 40, (STATES, 4)),
        clearance=np.linspace(0, 0.1, STATES),
        proprio=np.zeros((STATES, 12), np.float32),
        success=np.arange(STATES) == STATES - 1,
        success_tolerant=np.arange(STATES) == STATES - 1,
        failure=np.array(["time_out"] * (STATES - 1) + ["none"]),
        actions=rng.uniform(-1, 1, (STATES - 1, 5)),
        rewards=np.zeros(STATES - 1),
        terms={},
        images={name: rng.integers(0, 256, (STATES, SIZE, SIZE, 3), np.uint8) for name in ("gs", "mesh")},
    )


class BundleStub:
    """An asset of three splats."""

    def cloud(self) -> Cloud:
        quats = np.array([[1.0, 0, 0, 0], [0.5, 0.5, 0.5, 0.5], [0.6, 0.0, 0.8, 0.0]])
        return Cloud(np.eye(3), quats, np.full((3, 3), 0.01), np.full(3, 0.5), np.full((3, 3), 0.2))


@pytest.fixture
def files(tmp_path, monkeypatch) -> EpisodeFiles:
    monkeypatch.setattr(module, "read_asset", lambda path: BundleStub())
    write_episode(tmp_path / "episode.npz", made())
    for step in (0, 2, 4):
        write_image(tmp_path / "mirror" / f"{step:04d}.png", np.full((SIZE, SIZE, 3), 0.1 * step, np.float32))
    return EpisodeFiles(tmp_path / "episode.npz", robot().folder, "item", "background", tmp_path / "mirror")


def values(found: dict, entity: str, component: str) -> list:
    return [value.as_py() for value in found[entity]["components"][component]]


def test_every_body_moves_as_in_the_episode(files, tmp_path):
    record_episode(files, "mug+table", tmp_path / "out.rrd")
    found, episode = read_recording(tmp_path / "out.rrd"), made()
    links = robot().visuals()
    for name, entity in (("object", "/table/object"), *((link, f"/table/robot/{link}") for link in links)):
        assert found[entity]["rows"] == STATES
        assert {"step", "time"} <= found[entity]["timelines"]
        moved = [value[0] for value in values(found, entity, "Transform3D:translation")]
        np.testing.assert_allclose(moved, episode.body(name)[:, :3, 3], atol=1e-6)
        turned = [value[0] for value in values(found, entity, "Transform3D:mat3x3")]
        # rerun keeps matrices by columns.
        np.testing.assert_allclose(
            np.reshape(turned, (STATES, 3, 3)).transpose(0, 2, 1), episode.body(name)[:, :3, :3], atol=1e-6
        )
    for link, parts in links.items():
        for number in range(len(parts)):
            part = found[f"/table/robot/{link}/{number}"]
            assert part["static"]
            assert "Mesh3D:vertex_positions" in part["components"]
    eye = [value[0] for value in values(found, "/table/camera", "Transform3D:translation")]
    np.testing.assert_allclose(eye, episode.cam_from_table[:, :3, 3], atol=1e-6)
    for body in ("object", "background"):
        assert found[f"/table/{body}/splats"]["static"]
        assert len(values(found, f"/table/{body}/centres", "Points3D:positions")[0]) == 3


def test_curves_and_pictures_hold_what_the_episode_holds(files, tmp_path):
    record_episode(files, "mug+table", tmp_path / "out.rrd")
    found, episode = read_recording(tmp_path / "out.rrd"), made()
    for entity, wanted in (
        ("/plots/actions", episode.actions),
        ("/plots/forces", episode.forces),
        ("/plots/lengths", 1e3 * np.c_[episode.aperture, episode.clearance]),
    ):
        np.testing.assert_allclose(values(found, entity, "Scalars:scalars"), wanted, atol=1e-9)
        assert {"step", "time"} <= found[entity]["timelines"]
        assert len(values(found, entity, "SeriesLines:names")[0]) == wanted.shape[1]
    for name, renderer in (("splats", "gs"), ("mesh", "mesh")):
        blobs = values(found, f"/table/camera/{name}", "EncodedImage:blob")
        assert len(blobs) == STATES
        for blob, wanted in zip(blobs, episode.images[renderer], strict=True):
            image = cv2.imdecode(np.array(blob[0], np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
            np.testing.assert_array_equal(image, wanted)
    assert found["/table/camera/mirror"]["rows"] == 3
    text = values(found, "/summary", "TextDocument:text")[0][0]
    assert "**success** after 4 steps, 0.20 s" in text
    assert "3 of 5 states photographed" in text


def test_an_episode_without_photos_is_recorded_too(files, tmp_path):
    record_episode(EpisodeFiles(files.episode, files.robot, "item", "background"), "mug+table", tmp_path / "out.rrd")
    found = read_recording(tmp_path / "out.rrd")
    assert "/table/camera/mirror" not in found
    assert found["/table/camera/mesh"]["rows"] == STATES


def test_files_that_do_not_belong_together_are_refused(files, tmp_path):
    write_image(tmp_path / "mirror" / "0005.png", np.zeros((SIZE, SIZE, 3), np.float32))
    with pytest.raises(InputError, match="do not belong to an episode of 5 states"):
        record_episode(files, "mug+table", tmp_path / "out.rrd")
    description = tmp_path / "robot"
    description.mkdir()
    for path in robot().folder.iterdir():
        (description / path.name).write_bytes(path.read_bytes())
    record = {**robot().record, "visuals": {**robot().record["visuals"], "thumb": robot().record["visuals"]["palm"]}}
    write_json(description / "robot.json", record)
    with pytest.raises(InputError, match="no pose of thumb"):
        record_episode(EpisodeFiles(files.episode, description, "item", "background"), "mug+table", tmp_path / "out.rrd")
    assert not (tmp_path / "out.rrd").exists()
