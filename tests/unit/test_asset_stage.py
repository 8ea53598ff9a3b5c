"""The asset stage on small scenes made here: bundle, rest in PyBullet, the same bytes in a second run, bad input."""

from pathlib import Path

import numpy as np
import pybullet
import pytest
import trimesh
from pybullet_utils.bullet_client import BulletClient

from gsbridge.asset.body import mass_properties
from gsbridge.asset.bullet import body_from_inertial, load_body, rest_check, world_from_body
from gsbridge.asset.bundle import read_asset
from gsbridge.asset.hulls import hull_mesh
from gsbridge.asset.stage import AssetInputs, AssetOutputs, build_asset
from gsbridge.asset.urdf import write_body_urdf, write_obj
from gsbridge.configuration.asset import AssetSettings
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.geometry import rotation_from_quat
from gsbridge.meshes import Mesh, read_mesh, write_mesh
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.ply import write_ply

SIZE = np.array([0.06, 0.05, 0.04])
PLACE = np.array([0.1, -0.2, 0.0])


def rough_box(seed: int = 0) -> Mesh:
    """A subdivided box on the table with the roughness of a reconstruction: 0.3 mm, its foot clamped to z = 0."""
    box = trimesh.creation.box(SIZE).subdivide().subdivide().subdivide()
    vertices = np.asarray(box.vertices) + SIZE * [0, 0, 0.5] + PLACE
    vertices += np.random.default_rng(seed).normal(scale=1e-4, size=vertices.shape)
    vertices[:, 2] = np.maximum(vertices[:, 2], 0.0)
    return Mesh(vertices, np.asarray(box.faces, np.int64), np.full(vertices.shape, 0.5, np.float32))


def cloud_on(mesh: Mesh) -> Cloud:
    count = len(mesh.vertices)
    quats = np.tile([1.0, 0, 0, 0], (count, 1))
    return Cloud(mesh.vertices, quats, np.full((count, 3), 0.003), np.full(count, 0.8), np.full((count, 3), 0.5))


def make_inputs(folder: Path, visual: Mesh | None = None, collision: Mesh | None = None, scale_source="tags") -> AssetInputs:
    visual = rough_box() if visual is None else visual
    inputs = AssetInputs(*(folder / name for name in ("visual.ply", "collision.ply", "splats.ply", "align.json")))
    write_mesh(inputs.visual, visual)
    write_mesh(inputs.collision, rough_box() if collision is None else collision)
    write_ply(inputs.splats, cloud_on(rough_box() if visual is None else visual))
    write_json(inputs.align, {"scale": 1.0, "scale_source": scale_source})
    return inputs


def make_outputs(folder: Path) -> AssetOutputs:
    return AssetOutputs(*(folder / name for name in ("body.urdf", "hulls", "visual.ply", "splats.ply", "asset.json")))


def test_bundle_of_a_box_rests_where_it_was_filmed(tmp_path):
    outputs = make_outputs(tmp_path / "asset")
    build_asset(make_inputs(tmp_path), outputs, AssetSettings(density=700), name="box", seed=1)
    record = read_json(outputs.record)
    assert record["status"] == "pass", record["reasons"]
    assert record["rest"]["penetration_mm"] < 0.1
    assert record["rest"]["drift_mm"] < 0.2
    assert record["rest"]["drift_deg"] < 0.2
    asset = read_asset(outputs.record)
    assert asset.properties.mass == pytest.approx(700 * SIZE.prod(), rel=0.02)
    np.testing.assert_allclose(asset.properties.centre, [0, 0, SIZE[2] / 2], atol=5e-4)
    np.testing.assert_allclose(asset.body_from_table[:3, 3], -PLACE, atol=5e-4)
    assert asset.width == pytest.approx(0.05, abs=1e-3)
    assert asset.height == pytest.approx(0.04, abs=1e-3)
    np.testing.assert_allclose(asset.cloud().means, rough_box().vertices + asset.body_from_table[:3, 3], atol=1e-6)
    np.testing.assert_allclose(asset.mesh().vertices, rough_box().vertices + asset.body_from_table[:3, 3], atol=1e-6)
    true = np.concatenate([read_mesh(path).vertices for path in asset.hulls])
    assert abs(true[:, 2].min()) <= 1e-4
    bullet = np.concatenate([read_mesh(path).vertices for path in sorted(Path(outputs.hulls).glob("bullet_*.obj"))])
    assert bullet[:, 2].min() == pytest.approx(0.001, abs=1e-6)


def test_same_inputs_give_the_same_bytes(tmp_path):
    inputs = make_inputs(tmp_path)
    contents = []
    for name in ("one", "two"):
        outputs = make_outputs(tmp_path / name)
        build_asset(inputs, outputs, name="box", seed=3)
        files = [path for path in sorted((tmp_path / name).rglob("*")) if path.is_file()]
        contents.append({path.relative_to(tmp_path / name): path.read_bytes() for path in files})
    assert contents[0] == contents[1]


def test_exact_hulls_would_float_by_bullets_margin(tmp_path):
    """Why the hulls are made smaller: without, Bullet lifts the body by its margin."""
    outputs = make_outputs(tmp_path / "asset")
    build_asset(make_inputs(tmp_path), outputs, AssetSettings(margin=0.0), name="box")
    record = read_json(outputs.record)
    assert record["rest"]["drift_mm"] == pytest.approx(1.0, abs=0.1)
    assert record["rest"]["penetration_mm"] == pytest.approx(1.0, abs=0.1)
    assert record["status"] == "degraded"


def test_bullet_gets_mass_inertia_and_pose(tmp_path):
    mesh = hull_mesh(np.random.default_rng(2).normal(size=(30, 3)) * [0.03, 0.02, 0.01])
    properties = mass_properties(mesh, 800.0)
    write_obj(tmp_path / "body.obj", mesh)
    write_body_urdf(tmp_path / "body.urdf", "a & <b>", properties, visual="body.obj", collisions=["body.obj"])
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_quat(np.array([0.3, -0.5, 0.7, 0.2]))
    pose[:3, 3] = (0.1, 0.2, 0.3)
    client = BulletClient(pybullet.DIRECT)
    try:
        body = load_body(client, tmp_path / "body.urdf", pose)
        np.testing.assert_allclose(world_from_body(client, body), pose, atol=1e-6)
        dynamics = client.getDynamicsInfo(body, -1)
        assert dynamics[0] == pytest.approx(properties.mass, rel=1e-6)
        frame = body_from_inertial(client, body)
        np.testing.assert_allclose(frame[:3, 3], properties.centre, atol=1e-7)
        restored = frame[:3, :3] @ np.diag(dynamics[2]) @ frame[:3, :3].T
        np.testing.assert_allclose(restored, properties.inertia, atol=1e-5 * np.abs(properties.inertia).max())
    finally:
        client.disconnect()


def test_background_is_a_static_concave_body(tmp_path):
    """A tray: a body set into it must rest on its floor, not on the hull of its rim."""
    low, floor, rim = -0.04, 0.0, 0.02
    ring = [np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half for half in (0.2, 0.15)]
    vertices = np.concatenate(
        [
            np.insert(ring[0], 2, low, axis=1),
            np.insert(ring[0], 2, rim, axis=1),
            np.insert(ring[1], 2, rim, axis=1),
            np.insert(ring[1], 2, floor, axis=1),
        ]
    ).astype(float)
    faces = [[0, 2, 1], [0, 3, 2], [12, 13, 14], [12, 14, 15]]
    for level in range(3):
        for i in range(4):
            a, b = 4 * level + i, 4 * level + (i + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    tray = Mesh(vertices, np.array(faces), np.full(vertices.shape, 0.5, np.float32))
    assert tray.is_watertight()
    assert tray.volume() > 0
    outputs = make_outputs(tmp_path / "asset")
    build_asset(make_inputs(tmp_path, tray, tray), outputs, name="tray", kind="background")
    asset = read_asset(outputs.record)
    assert asset.properties is None
    np.testing.assert_array_equal(asset.body_from_table, np.eye(4))
    client = BulletClient(pybullet.DIRECT)
    try:
        client.setGravity(0, 0, -9.81)
        client.setTimeStep(1e-3)
        load_body(client, asset.urdf, static=True)
        box = client.createCollisionShape(client.GEOM_BOX, halfExtents=[0.03, 0.03, 0.03])
        body = client.createMultiBody(0.1, box, basePosition=[0, 0, 0.035])
        for _ in range(600):
            client.stepSimulation()
        assert client.getBasePositionAndOrientation(body)[0][2] == pytest.approx(0.03, abs=3e-4)
    finally:
        client.disconnect()


def test_hulls_that_are_too_few_for_a_hollow_body_are_told(tmp_path):
    """Two towers on a plate, and one hull for all three."""
    parts = [((0.1, 0.03, 0.01), 0.0, 0.005), ((0.02, 0.03, 0.06), -0.04, 0.04), ((0.02, 0.03, 0.06), 0.04, 0.04)]
    scene = trimesh.util.concatenate([trimesh.creation.box(size).apply_translation((x, 0, z)) for size, x, z in parts])
    body = Mesh(np.asarray(scene.vertices), np.asarray(scene.faces, np.int64), np.full(scene.vertices.shape, 0.5, np.float32))
    for most, told in ((1, True), (12, False)):
        outputs = make_outputs(tmp_path / str(most))
        build_asset(make_inputs(tmp_path, body, body), outputs, AssetSettings(most_hulls=most), name="towers", seed=1)
        record = read_json(outputs.record)
        assert any("most_hulls" in reason for reason in record["reasons"]) == told, record["reasons"]
        # The middle of the two towers' gap, 30 mm from either, is as far from the plate.
        assert record["hulls"]["filled_mm"] == pytest.approx(30, abs=1.5) if told else record["hulls"]["filled_mm"] < 5


def lifted(mesh: Mesh, height: float) -> Mesh:
    return Mesh(mesh.vertices + np.array([0, 0, height]), mesh.faces, mesh.colours)


def scaled(mesh: Mesh, factor: float) -> Mesh:
    return Mesh(mesh.vertices * factor, mesh.faces, mesh.colours)


def opened(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:-1], mesh.colours)


def test_open_visual_mesh_falls_back_to_the_outlines_hull(tmp_path):
    outputs = make_outputs(tmp_path / "asset")
    build_asset(make_inputs(tmp_path, opened(rough_box())), outputs, name="box")
    record = read_json(outputs.record)
    assert record["solid"] == "collision"
    assert record["status"] == "degraded"
    assert "not watertight" in record["reasons"][0]


def test_small_gap_to_the_table_is_closed_and_noted(tmp_path):
    outputs = make_outputs(tmp_path / "asset")
    build_asset(make_inputs(tmp_path, lifted(rough_box(), 0.003)), outputs, name="box")
    record = read_json(outputs.record)
    assert record["body_from_table"][2][3] == pytest.approx(-0.003, abs=5e-4)
    assert any("above the table" in reason for reason in record["reasons"])
    assert record["rest"]["drift_mm"] < 0.2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda i: write_mesh(i.visual, scaled(rough_box(), 333)), "measures 19.98 m|measures 20"),
        (lambda i: write_mesh(i.visual, scaled(rough_box(), 0.01)), "measures"),
        (lambda i: write_mesh(i.collision, scaled(rough_box(), 333)), "measures 19.98 m|measures 20"),
        (lambda i: Path(i.visual).unlink(), "does not exist"),
        (lambda i: Path(i.collision).unlink(), "does not exist"),
        (lambda i: Path(i.splats).unlink(), "cannot be read"),
        (lambda i: [write_mesh(p, opened(rough_box())) for p in (i.visual, i.collision)], "encloses no volume either"),
        (lambda i: write_json(i.align, {"scale_source": "unknown"}), "scale of the capture is unknown"),
        (lambda i: write_mesh(i.visual, lifted(rough_box(), 0.006)), "lowest point is 6.0 mm"),
        (lambda i: write_ply(i.splats, cloud_on(lifted(rough_box(), 1.0))), "lie away from the mesh"),
    ],
)
def test_bad_scenes_are_refused(tmp_path, change, message):
    inputs = make_inputs(tmp_path)
    change(inputs)
    with pytest.raises(InputError, match=message):
        build_asset(inputs, make_outputs(tmp_path / "asset"), name="box")
    assert not (tmp_path / "asset" / "asset.json").exists()


def test_bad_settings_and_open_backgrounds_are_refused(tmp_path):
    inputs, outputs = make_inputs(tmp_path), make_outputs(tmp_path / "asset")
    with pytest.raises(InputError, match=r"density: 'air' is not possible.*Give one of: foam, plush"):
        build_asset(inputs, outputs, AssetSettings(density="air"), name="box")
    with pytest.raises(InputError, match="'robot' is unknown"):
        build_asset(inputs, outputs, name="box", kind="robot")
    write_mesh(inputs.collision, opened(rough_box()))
    with pytest.raises(InputError, match="fall into it"):
        build_asset(inputs, outputs, name="box", kind="background")


def test_damaged_bundles_are_refused(tmp_path):
    outputs = make_outputs(tmp_path / "asset")
    build_asset(make_inputs(tmp_path), outputs, name="box")
    Path(outputs.splats).unlink()
    with pytest.raises(InputError, match="missing"):
        read_asset(outputs.record)
    write_json(outputs.record, {"kind": "object"})
    with pytest.raises(InputError, match="damaged"):
        read_asset(outputs.record)
    with pytest.raises(InputError, match="cannot load"):
        rest_check(tmp_path / "nothing.urdf")
