"""Scores of one scene's reconstruction against the hidden truth.

Camera centres, scale, tilt and height are compared as they leave the align stage: the board alone placed them, and nothing
is fitted to the truth before the camera error is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.distance import pdist

from gsbridge.cameras import Camera, View, camera_centre, read_views
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.geometry import Array, align_similarity
from gsbridge.images import read_mask
from gsbridge.libraries import import_open3d
from gsbridge.meshes import Mesh, read_mesh
from gsbridge.report.scores.shape import hole_scores, shape_scores, wrong_and_pass


@dataclass(frozen=True)
class Truth:
    """True cameras and poses of a film.

    Args:
        camera: True camera of the film, with distortion.
        poses: `cam_from_table` of each frame, by file name, m. [4, 4].
        target: Name of the filmed object, None for a background.
    """

    camera: Camera
    poses: dict[str, Array]
    target: str | None

    def centres(self) -> dict[str, Array]:
        """Camera positions by frame name, table frame, m. [3]."""
        return {name: camera_centre(pose) for name, pose in self.poses.items()}


def read_truth(path: str | Path) -> Truth:
    """Read `truth.json`.

    Raises:
        InputError: The file is missing or damaged.
    """
    content = read_json(path)
    try:
        poses = {frame["name"]: np.array(frame["cam_from_table"], dtype=np.float64) for frame in content["frames"]}
        if any(pose.shape != (4, 4) for pose in poses.values()):
            raise ValueError("a pose is no 4x4 matrix")
        return Truth(Camera.from_json(content["camera"]), poses, content.get("object"))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(path, f"the truth is damaged ({error!r})", "Film the scene again") from error


def undistort_mask(mask: Array, camera: Camera, pinhole: Camera) -> Array:
    """A mask filmed through a lens, as the undistorted camera would see it.

    Args:
        mask: Film pixels, 0..1. [H, W].
        camera: Camera of the film, with distortion: the *estimated* one, since the estimated mask lies in images that
            were undistorted with it.
        pinhole: Camera of the undistorted image.

    Returns:
        Bilinear mask in the undistorted image; outside the film it is 0. [H', W'] float32.

    Raises:
        ValueError: The mask has another size than the camera.
    """
    if mask.shape != (camera.height, camera.width):
        raise ValueError(f"the mask is {mask.shape[1]}x{mask.shape[0]}, its camera {camera.width}x{camera.height}")
    # OpenCV counts pixel centres from 0, we from 0.5.
    filmed, flat = (replace(c, cx=c.cx - 0.5, cy=c.cy - 0.5).intrinsics for c in (camera, pinhole))
    size = (pinhole.width, pinhole.height)
    maps = cv2.initUndistortRectifyMap(filmed, np.array(camera.distortion), None, flat, size, cv2.CV_32FC1)
    source = np.ascontiguousarray(mask, dtype=np.float32)
    return cv2.remap(source, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)


def mask_iou(mask: Array, reference: Array) -> float:
    """Intersection over union of two masks, cut at 0.5; 1 where both are empty. [H, W] each."""
    a, b = np.asarray(mask) >= 0.5, np.asarray(reference) >= 0.5
    union = np.count_nonzero(a | b)
    return float(np.count_nonzero(a & b) / union) if union else 1.0


ABOVE_M = 0.003
"""Height above which surfaces count, m: no camera sees the bottom, so that it is not measured."""

WORKING_AREA_M = 0.30
"""Edge of the square on the table, round the object, where tilt and height of the table matter, m."""


def camera_scores(centres: Array, true_centres: Array, rotations: Array, area_centre: Array) -> dict[str, float]:
    """Errors of the camera poses and of the table plane that they imply.

    Args:
        centres: Estimated camera positions, table frame, m. [N, 3].
        true_centres: True camera positions in the same order, m. [N, 3].
        rotations: `true_table_from_table` as each camera alone implies it: `true R^T @ estimated R`. [N, 3, 3].
        area_centre: Centre of the working area on the table, m. [2].

    Returns:
        camera_mm_median, camera_mm_max: distance between centres, nothing fitted.
        scale_percent: median ratio of distances between cameras, over the wider half of all pairs, against 1 (signed).
        tilt_deg, height_mm: angle and largest displacement of the estimated table plane over the working area, after
            the best similarity from estimated to true centres.
        height_centre_mm: height of the estimated table at the centre of the area, by the same similarity (signed).
        yaw_deg: rotation about the table's normal by the same similarity.
        tilt_by_rotations_deg: the same tilt from the cameras' orientations, as a check.
    """
    error = np.linalg.norm(centres - true_centres, axis=1) * 1e3
    wide, true_wide = pdist(centres), pdist(true_centres)
    pairs = true_wide >= np.median(true_wide)
    ratio = float(np.median(wide[pairs] / true_wide[pairs]))
    fit = align_similarity(centres, true_centres)
    half = WORKING_AREA_M / 2
    grid = np.array([[x, y, 0.0] for x in (-half, 0.0, half) for y in (-half, 0.0, half)])
    corners = grid + np.array([*area_centre, 0.0])
    normal = fit.rotation[:, 2]
    u, _, vt = np.linalg.svd(rotations.mean(0))
    mean_rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return {
        "camera_mm_median": float(np.median(error)),
        "camera_mm_max": float(error.max()),
        "scale_percent": (ratio - 1.0) * 100,
        "tilt_deg": _tilt_deg(normal),
        "height_mm": float(np.abs(fit.apply(corners)[:, 2]).max() * 1e3),
        "height_centre_mm": float(fit.apply(np.array([*area_centre, 0.0]))[2] * 1e3),
        "yaw_deg": float(np.degrees(np.arctan2(fit.rotation[1, 0], fit.rotation[0, 0]))),
        "tilt_by_rotations_deg": _tilt_deg(mean_rotation[:, 2]),
    }


def _tilt_deg(normal: Array) -> float:
    """Angle between a direction and z, degrees; precise near 0. [3]."""
    return float(np.degrees(np.arctan2(np.linalg.norm(normal[:2]), normal[2])))


def mask_scores(masks: Path, true_masks: Path, views: Sequence[View], camera: Camera) -> dict[str, Any]:
    """IoU of the masks with the true ones, and the share of the true holes that they leave open, over all registered views.

    Args:
        masks: Folder of estimated masks, undistorted pixels.
        true_masks: Folder of true masks, film pixels.
        views: Registered views.
        camera: Estimated camera of the film, with distortion.
    """
    found = {}
    pairs = []
    for view in views:
        name = f"{Path(view.name).stem}.png"
        true = undistort_mask(read_mask(true_masks / name), camera, view.camera)
        mask = read_mask(masks / name)
        if mask.shape != true.shape:
            raise InputError(masks / name, "the mask has another size than its view", "Run the masks stage again")
        found[view.name] = mask_iou(mask, true)
        pairs.append((mask, true))
    worst = min(found, key=found.__getitem__)
    return {
        "mask_iou_mean": float(np.mean(list(found.values()))),
        "mask_iou_min": found[worst],
        "mask_worst": worst,
        "masks": len(found),
        **hole_scores(pairs),
    }


def sample_surface(mesh: Mesh, count: int, seed: int) -> Array:
    """Random points spread evenly by area over a surface.

    Args:
        mesh: The surface.
        count: Number of points.
        seed: Random seed.

    Returns:
        Points in the mesh's frame and unit. [count, 3].
    """
    rng = np.random.default_rng(seed)
    areas = mesh.areas()
    face = rng.choice(len(areas), size=count, p=areas / areas.sum())
    a, b, c = np.moveaxis(mesh.corners()[face], 1, 0)
    r1, r2 = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return (1 - r1) * a + r1 * (1 - r2) * b + r1 * r2 * c


def surface_distance(points: Array, mesh: Mesh) -> Array:
    """Distance of points to the nearest point of a surface, m. [N, 3] -> [N]."""
    open3d = import_open3d()
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    return scene.compute_distance(np.ascontiguousarray(points, dtype=np.float32), nthreads=1).numpy().astype(np.float64)


def chamfer(mesh: Mesh, reference: Mesh, *, above: float = ABOVE_M, samples: int = 20_000, seed: int = 0) -> dict[str, float]:
    """Distance between two surfaces above a height: samples of each against the whole of the other.

    Args:
        mesh, reference: Estimated and true surface, table frame.
        above: Samples at or below this height are left out, m.
        samples: Samples per surface before the cut.
        seed: Seed of the samples.

    Returns:
        accuracy_mm (estimated to true), completeness_mm (true to estimated), chamfer_mm (their mean).

    Raises:
        ValueError: A surface has no sample above the height.
    """
    means = []
    for source, target in ((mesh, reference), (reference, mesh)):
        points = sample_surface(source, samples, seed)
        points = points[points[:, 2] > above]
        if len(points) == 0:
            raise ValueError("a surface has nothing above the cutting height")
        means.append(float(surface_distance(points, target).mean() * 1e3))
    return {"accuracy_mm": means[0], "completeness_mm": means[1], "chamfer_mm": sum(means) / 2}


def mesh_scores(visual: Path, collision: Path, true_mesh: Path, seed: int) -> dict[str, Any]:
    """Chamfer distances of an object's two meshes, errors of shape that those hide, and whether the meshes are closed.

    Args:
        visual: File of the mesh that is drawn.
        collision: File of the mesh that is touched.
        true_mesh: File of the true mesh, in the same frame.
        seed: Seed of the points that distances are measured from.

    Raises:
        InputError: A mesh cannot be used.
    """
    reference = read_mesh(true_mesh)
    out: dict[str, Any] = {}
    for name, path in (("visual", visual), ("collision", collision)):
        mesh = read_mesh(path)
        try:
            out |= {f"{name}_{key}": value for key, value in chamfer(mesh, reference, seed=seed).items()}
        except ValueError as error:
            raise InputError(path, str(error), "Look at the mesh, then run the mesh stage again") from error
        out |= shape_scores(name, mesh, reference)
        out[f"{name}_watertight"] = mesh.is_watertight()
    return out


def table_scores(visual: Path, true_mesh: Path) -> dict[str, float]:
    """Size of a background's mesh, and how much of it lies beyond the true table.

    Returns:
        table_long_m, table_short_m: sides of its bounding rectangle, m; table_outside_percent: share of its area beyond the
        true table.
    """
    mesh, true = read_mesh(visual), read_mesh(true_mesh).vertices
    sides = np.sort(np.ptp(mesh.vertices[:, :2], axis=0))
    centroids, areas = mesh.corners().mean(1)[:, :2], mesh.areas()
    slack = 0.005
    beyond = ((centroids < true[:, :2].min(0) - slack) | (centroids > true[:, :2].max(0) + slack)).any(1)
    return {
        "table_long_m": float(sides[1]),
        "table_short_m": float(sides[0]),
        "table_outside_percent": 100 * float(areas[beyond].sum() / areas.sum()),
    }


def score_scene(
    *,
    scene: str,
    kind: str,
    sfm_json: str | Path,
    views_json: str | Path,
    images: str | Path,
    truth_json: str | Path,
    masks: str | Path | None = None,
    true_masks: str | Path | None = None,
    visual: str | Path | None = None,
    collision: str | Path | None = None,
    true_mesh: str | Path | None = None,
    masks_json: str | Path | None = None,
    mesh_json: str | Path | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Score one scene of the mirror against its truth.

    Args:
        scene: Scene name.
        kind: `object` or `background`; masks and chamfer distances are for objects, the table's size for backgrounds.
        sfm_json: Record of the sfm stage: registered, total, distorted camera.
        views_json: Cameras and poses after alignment.
        images: Folder of undistorted images that `views_json` names.
        truth_json: True cameras and poses.
        masks, true_masks: Folders of estimated and true masks; None leaves them out.
        visual, collision, true_mesh: Meshes; None leaves them out.
        masks_json, mesh_json: Records of an object's stages, with their status; None leaves `wrong_and_pass` out.
        seed: Seed of the surface samples.

    Returns:
        Figures by name, units in the names.

    Raises:
        InputError: A file is missing or damaged, or fewer than three registered views have a true pose.
    """
    record, truth, views = read_json(sfm_json), read_truth(truth_json), read_views(views_json, images)
    common = [view for view in views if view.name in truth.poses]
    if len(common) < 3:
        raise InputError(
            views_json, "fewer than three registered views have a true pose", "Check that film and truth belong together"
        )
    out: dict[str, Any] = {
        "scene": scene,
        "kind": kind,
        "registered": int(record["registered"]),
        "keyframes": int(record["total"]),
        "registered_percent": 100.0 * int(record["registered"]) / int(record["total"]),
        **_pose_scores(common, truth, _area_centre(true_mesh)),
    }
    if kind == "object" and masks is not None and true_masks is not None:
        out |= mask_scores(Path(masks), Path(true_masks), common, Camera.from_json(record["camera"]))
    if kind == "object" and visual is not None and collision is not None and true_mesh is not None:
        out |= mesh_scores(Path(visual), Path(collision), Path(true_mesh), seed)
    if kind == "background" and visual is not None and true_mesh is not None:
        out |= table_scores(Path(visual), Path(true_mesh))
    if kind == "object" and masks_json is not None and mesh_json is not None:
        records = {"masks": read_json(masks_json), "mesh": read_json(mesh_json)}
        out |= {f"{stage}_status": content["status"] for stage, content in records.items()}
        out["reasons"] = [reason for content in records.values() for reason in content["reasons"]]
        out["wrong_and_pass"] = wrong_and_pass(out, out["masks_status"], out["mesh_status"])
    return out


def _pose_scores(views: Sequence[View], truth: Truth, area_centre: Array) -> dict[str, float]:
    """`camera_scores` of registered views against the truth's poses."""
    centres = truth.centres()
    rotations = [truth.poses[view.name][:3, :3].T @ view.cam_from_table[:3, :3] for view in views]
    return camera_scores(
        np.array([view.centre for view in views]),
        np.array([centres[view.name] for view in views]),
        np.array(rotations),
        area_centre,
    )


def _area_centre(true_mesh: str | Path | None) -> Array:
    """Centre of the working area: the footprint of the true mesh, or the table's origin. [2]."""
    if true_mesh is None:
        return np.zeros(2)
    vertices = read_mesh(true_mesh).vertices
    return (vertices[:, :2].min(0) + vertices[:, :2].max(0)) / 2


def write_scene_score(out: str | Path, **arguments: Any) -> None:
    """Write the scores of one scene as JSON; arguments as in `score_scene`."""
    write_json(out, score_scene(**arguments))
