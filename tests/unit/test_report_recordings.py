"""rerun recordings hold what the stages' files say, seen by reading them back."""

from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
import trimesh
from recording_file import read_recording

from gsbridge.asset.stage import AssetInputs, AssetOutputs, build_asset
from gsbridge.cameras import Camera, View, look_at, write_views
from gsbridge.files import write_json
from gsbridge.images import write_image
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.photogrammetry.board import standard_board
from gsbridge.report.recordings.align import record_align, triangulate
from gsbridge.report.recordings.asset import record_asset
from gsbridge.report.recordings.capture import record_capture
from gsbridge.report.recordings.masks import record_masks
from gsbridge.report.recordings.mesh import record_mesh
from gsbridge.report.recordings.sfm import record_sfm
from gsbridge.report.recordings.splats import record_splats
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.ply import write_ply

ASSET_FILES = ("body.urdf", "hulls", "visual.ply", "splats.ply", "asset.json")
CAMERA = Camera(80, 60, 70.0, 70.0, 40.0, 30.0)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return tmp_path / "results" / "scenes" / "cube"


def _photos(folder: Path, count: int) -> list[str]:
    rng = np.random.default_rng(0)
    names = [f"{index:04d}.png" for index in range(count)]
    for name in names:
        write_image(folder / name, rng.random((60, 80, 3)).astype(np.float32))
    return names


def _views(scene: Path, count: int = 3) -> list[View]:
    poses = [look_at(np.array([0.5 * np.cos(a), 0.5 * np.sin(a), 0.4]), np.zeros(3)) for a in np.linspace(0, 2, count)]
    names = _photos(scene / "sfm" / "images", count)
    views = [View(name, CAMERA, pose) for name, pose in zip(names, poses, strict=True)]
    write_views(scene / "align" / "views.json", views)
    return views


def _points(found: dict, component: str) -> np.ndarray:
    return np.array(found["components"][component][0].as_py())


def test_capture_keeps_every_keyframe_on_both_time_lines(scene: Path) -> None:
    names = _photos(scene / "capture" / "frames", 3)
    frames = [
        {"name": name, "index": 10 * i, "time_s": 0.5 * i, "sharpness": 100.0 + i, "motion_px": 7.0 * i, "split": "train"}
        for i, name in enumerate(names)
    ]
    write_json(scene / "capture" / "keyframes.json", {"frames": frames})
    record_capture(scene / "capture" / "keyframes.json", scene / "capture" / "frames", scene / "out.rrd")
    found = read_recording(scene / "out.rrd")
    assert found["/keyframe/photo"]["rows"] == 3
    assert {"keyframe", "time"} <= found["/keyframe/photo"]["timelines"]
    scalars = found["/plots/motion_px"]["components"]["Scalars:scalars"]
    assert [value.as_py() for value in scalars] == [[0.0], [7.0], [14.0]]
    blob = np.array(found["/keyframe/photo"]["components"]["EncodedImage:blob"][0].as_py()[0], dtype=np.uint8)
    assert cv2.imdecode(blob, cv2.IMREAD_COLOR).shape == (60, 80, 3)


def test_align_shows_where_the_photos_see_the_tags(scene: Path) -> None:
    views, board = _views(scene), standard_board("a4")
    tags = {}
    for view in views:
        corners = {
            tag: view.camera.project(points @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3]).tolist()
            for tag, points in board.corners().items()
        }
        tags[view.name] = corners
    write_json(scene / "sfm" / "tags.json", tags)
    write_json(scene / "align" / "align.json", {"status": "pass", "reasons": [], "scale": 1.0})
    points = np.random.default_rng(1).random((5, 3))
    np.savez(scene / "align" / "points.npz", points=points, colours=np.full((5, 3), 7, np.uint8))
    record_align(
        scene / "align" / "align.json",
        scene / "align" / "views.json",
        scene / "sfm" / "images",
        scene / "align" / "points.npz",
        scene / "sfm" / "tags.json",
        board,
        scene / "out.rrd",
    )
    found = read_recording(scene / "out.rrd")
    seen = _points(found["/table/tags_seen"], "Points3D:positions")
    layout = np.concatenate(list(board.corners().values()))
    np.testing.assert_allclose(np.sort(seen, axis=0), np.sort(layout, axis=0), atol=1e-6)
    np.testing.assert_allclose(_points(found["/table/points"], "Points3D:positions"), points, atol=1e-6)
    assert found["/table/view/photo"]["rows"] == 3
    assert sum(path.startswith("/table/cameras/") for path in found) == 3
    pose = found["/table/view"]["components"]["Transform3D:translation"][1].as_py()[0]
    np.testing.assert_allclose(pose, views[1].cam_from_table[:3, 3], atol=1e-6)


def test_triangulation_finds_a_known_point() -> None:
    point = np.array([0.03, -0.02, 0.05])
    sights = []
    for angle in (0.0, 0.7, 2.0):
        pose = look_at(np.array([np.cos(angle), np.sin(angle), 0.8]), np.zeros(3))
        sights.append((CAMERA, pose, CAMERA.project(pose[:3, :3] @ point + pose[:3, 3])))
    np.testing.assert_allclose(triangulate(sights), point, atol=1e-9)


def test_masks_are_logged_as_classes_with_their_area(scene: Path) -> None:
    for view in _views(scene):
        mask = np.zeros((60, 80), np.uint8)
        mask[10:40, 20:60] = 255
        write_image(scene / "masks" / "images" / view.name, mask)
    record_masks(scene / "align" / "views.json", scene / "sfm" / "images", scene / "masks" / "images", scene / "out.rrd")
    found = read_recording(scene / "out.rrd")
    area = found["/plots/area_percent"]["components"]["Scalars:scalars"]
    assert [value.as_py() for value in area] == [[25.0]] * 3
    buffer = np.array(found["/photo/mask"]["components"]["SegmentationImage:buffer"][0].as_py()[0], dtype=np.uint8)
    assert buffer.sum() == 30 * 40
    assert found["/photo/outline"]["rows"] == 3


def test_meshes_keep_their_geometry(scene: Path) -> None:
    (scene / "mesh").mkdir(parents=True)
    box, ball = trimesh.creation.box((0.1, 0.1, 0.1)), trimesh.creation.icosphere(1, 0.05)
    box.export(scene / "mesh" / "visual.ply")
    ball.export(scene / "mesh" / "collision.ply")
    record_mesh(scene / "mesh" / "visual.ply", scene / "mesh" / "collision.ply", scene / "out.rrd")
    found = read_recording(scene / "out.rrd")
    np.testing.assert_allclose(_points(found["/table/visual"], "Mesh3D:vertex_positions"), box.vertices, atol=1e-6)
    normals = _points(found["/table/collision"], "Mesh3D:vertex_normals")
    outward = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    assert (normals * outward).sum(1).min() > 0.99


def test_assets_keep_their_parts_in_the_body_frame(scene: Path) -> None:
    folder = scene / "asset"
    box = trimesh.creation.box((0.06, 0.05, 0.04)).subdivide().subdivide().subdivide()
    vertices = np.asarray(box.vertices) + np.array([0.1, -0.2, 0.02])
    mesh = Mesh(vertices, np.asarray(box.faces, np.int64), np.full(vertices.shape, 0.5, np.float32))
    inputs = AssetInputs(*(scene / name for name in ("v.ply", "c.ply", "s.ply", "align.json")))
    write_mesh(inputs.visual, mesh)
    write_mesh(inputs.collision, mesh)
    count, quats = len(vertices), np.tile([1.0, 0, 0, 0], (len(vertices), 1))
    write_ply(inputs.splats, Cloud(vertices, quats, np.full((count, 3), 0.003), np.full(count, 0.8), np.full((count, 3), 0.5)))
    write_json(inputs.align, {"scale_source": "tags"})
    build_asset(inputs, AssetOutputs(*(folder / name for name in ASSET_FILES)), name="mug")
    record_asset(folder / "asset.json", scene / "out.rrd")
    found = read_recording(scene / "out.rrd")
    surface = _points(found["/body/surface"], "Mesh3D:vertex_positions")
    np.testing.assert_allclose(surface, vertices - [0.1, -0.2, 0.0], atol=1e-5)
    hull = _points(found["/body/hulls/hull_00"], "Mesh3D:vertex_positions")
    np.testing.assert_allclose(np.ptp(hull, axis=0), [0.06, 0.05, 0.04], atol=1e-3)
    np.testing.assert_allclose(_points(found["/body/centre_of_mass"], "Points3D:positions"), [[0, 0, 0.02]], atol=1e-4)


def test_splats_keep_shape_order_and_opacity(scene: Path) -> None:
    folder = scene / "splats" / "soft"
    quats = np.array([[1.0, 0, 0, 0], [0.5, 0.5, 0.5, 0.5], [0.6, 0.0, 0.8, 0.0]])
    colours = np.array([[1.0, 0, 0], [0, 1.0, 0], [0.2, 0.4, 0.6]])
    cloud = Cloud(np.eye(3), quats, np.full((3, 3), 0.01) * [[1], [2], [3]], np.array([0.2, 0.5, 0.9]), colours)
    write_ply(folder / "splats.ply", cloud)
    _photos(folder / "views", 2)
    figures = {"views": 2, "psnr": 30.0, "ssim": 0.9, "lpips": None, "alpha_iou": 0.98}
    record = {
        "status": "pass",
        "reasons": [],
        "binding": "soft",
        "splats": 3,
        "metrics": {"held_out": {"masked": figures}},
        "curve": [[100, 0.2, 20.0], [200, 0.1, 25.0]],
    }
    write_json(folder / "splats.json", record)
    record_splats(folder / "splats.ply", folder / "splats.json", folder / "views", scene / "out.rrd")
    found = read_recording(scene / "out.rrd")
    splats = found["/table/splats"]
    np.testing.assert_allclose(_points(splats, "GaussianSplats3D:quaternions"), quats[:, [1, 2, 3, 0]], atol=1e-6)
    np.testing.assert_allclose(_points(splats, "GaussianSplats3D:scales")[:, 0], [0.01, 0.02, 0.03], atol=1e-6)
    packed = _points(splats, "GaussianSplats3D:colors").astype(np.uint32)
    assert [hex(value) for value in packed] == ["0xff000033", "0xff0080", "0x336699e6"]
    assert [value.as_py() for value in found["/curve/psnr"]["components"]["Scalars:scalars"]] == [[20.0], [25.0]]
    assert all(found[f"/pictures/{name}"]["static"] for name in ("0000", "0001"))
    assert "step" in found["/curve/loss"]["timelines"]


def test_sfm_shows_points_and_cameras_of_the_model(scene: Path) -> None:
    options = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_cameras_per_rig=1, num_frames_per_rig=3, num_points3D=20)
    options.camera_model_id = pycolmap.CameraModelId.PINHOLE
    options.camera_params = [70.0, 70.0, 40.0, 30.0]
    options.camera_width, options.camera_height = 80, 60
    model = pycolmap.synthesize_dataset(options)
    (scene / "sfm" / "model").mkdir(parents=True)
    model.write(scene / "sfm" / "model")
    images = sorted((image for image in model.images.values()), key=lambda image: image.name)
    for image in images:
        write_image(scene / "sfm" / "images" / image.name, np.zeros((60, 80, 3), np.float32))
    record = {"status": "degraded", "reasons": ["3 of 4"], "registered": 3, "total": 4, "reprojection_px": 0.5}
    write_json(scene / "sfm" / "sfm.json", {**record, "mapper": "incremental", "retries": 1})
    record_sfm(scene / "sfm" / "model", scene / "sfm" / "images", scene / "sfm" / "sfm.json", scene / "out.rrd")
    found = read_recording(scene / "out.rrd")
    wanted = np.array([model.points3D[key].xyz for key in sorted(model.points3D)])
    np.testing.assert_allclose(_points(found["/model/points"], "Points3D:positions"), wanted, atol=1e-5)
    logged = [value.as_py()[0] for value in found["/model/view"]["components"]["Transform3D:translation"]]
    np.testing.assert_allclose(logged, [image.cam_from_world().translation for image in images], atol=1e-5)
    assert "3 of 4" in found["/summary"]["components"]["TextDocument:text"][0].as_py()[0]
