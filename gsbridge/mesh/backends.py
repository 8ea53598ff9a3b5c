"""External programs for depth: pycolmap's dense stereo where CUDA is available, OpenMVS where its binaries are found."""

from __future__ import annotations

import logging
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gsbridge.cameras import Views
from gsbridge.errors import InputError, StageError
from gsbridge.geometry import Array, quat_from_rotation
from gsbridge.images import read_image_u8, write_image

logger = logging.getLogger("gsbridge")

_OPENMVS = ("InterfaceCOLMAP", "DensifyPointCloud")


def has_pycolmap_stereo() -> bool:
    """True if this pycolmap was built with CUDA and a device answers."""
    try:
        import pycolmap
    except ImportError:
        return False
    if not pycolmap.has_cuda:
        return False
    return shutil.which("nvidia-smi") is not None and subprocess.run(["nvidia-smi"], capture_output=True).returncode == 0


def openmvs_binaries() -> dict[str, str] | None:
    """Paths of OpenMVS's programs on the search path; None unless all are there."""
    found = {name: shutil.which(name) for name in _OPENMVS}
    return {name: path for name, path in found.items() if path} if all(found.values()) else None


def choose_backend(wanted: str) -> str:
    """The depth backend to use.

    Args:
        wanted: `auto`, `sweep`, `pycolmap` or `openmvs`.

    Returns:
        `sweep`, `pycolmap` or `openmvs`. `auto` takes pycolmap where CUDA is available, else OpenMVS where it
        is installed, else the sweep.

    Raises:
        InputError: The backend cannot run here.
    """
    if wanted == "sweep":
        return wanted
    if wanted == "pycolmap":
        if not has_pycolmap_stereo():
            raise InputError("mesh.backend", "pycolmap's dense stereo needs CUDA", "Install pycolmap-cuda12, or use sweep")
        return wanted
    if wanted == "openmvs":
        if openmvs_binaries() is None:
            raise InputError("mesh.backend", f"OpenMVS ({', '.join(_OPENMVS)}) is not on the PATH", "Install it, or use sweep")
        return wanted
    return "pycolmap" if has_pycolmap_stereo() else "openmvs" if openmvs_binaries() else "sweep"


def write_colmap_workspace(views: Views, masks: Sequence[Array], folder: Path, points: Array) -> None:
    """Write photos (black outside the mask) and a COLMAP text model in the table frame, as dense stereo wants them.

    Args:
        views, masks: Photos and masks. [H, W] each.
        folder: An empty folder; gets `images/` (numbered from 000001.png in the order of the views), `sparse/` and `stereo/`.
        points: Points on the object, m; they tell COLMAP the depth range and OpenMVS the neighbours. [N, 3].
    """
    for name in ("images", "sparse", "stereo/depth_maps", "stereo/normal_maps", "stereo/consistency_graphs"):
        (folder / name).mkdir(parents=True)
    # In COLMAP's text files a name ends at a blank, so the photos are numbered.
    names = [f"{number:06d}.png" for number in range(1, len(views) + 1)]
    cameras, images = [], []
    tracks: list[list[tuple[int, int]]] = [[] for _ in points]
    for number, (name, view, mask) in enumerate(zip(names, views, masks, strict=True), start=1):
        photo = read_image_u8(views.path(view))
        grown = cv2.dilate((mask > 0.5).astype(np.uint8), np.ones((9, 9), np.uint8))
        write_image(folder / "images" / name, photo * grown[..., None])
        c = view.camera
        cameras.append(f"{number} PINHOLE {c.width} {c.height} {c.fx:.17g} {c.fy:.17g} {c.cx:.17g} {c.cy:.17g}")
        pose = " ".join(repr(float(v)) for v in [*quat_from_rotation(view.cam_from_table[:3, :3]), *view.cam_from_table[:3, 3]])
        pixels = c.project(points @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3])
        seen = np.isfinite(pixels).all(axis=1) & (pixels > 0).all(axis=1) & (pixels < (c.width, c.height)).all(axis=1)
        index = np.flatnonzero(seen)
        index = index[mask[pixels[index, 1].astype(int), pixels[index, 0].astype(int)] > 0.5]
        for place, point in enumerate(index):
            tracks[point].append((number, place))
        observed = " ".join(f"{pixels[point, 0]:.3f} {pixels[point, 1]:.3f} {point + 1}" for point in index)
        images.append(f"{number} {pose} {number} {name}\n{observed}")
    lines = []
    for point, (position, track) in enumerate(zip(points, tracks, strict=True), start=1):
        if track:
            places = " ".join(f"{image} {place}" for image, place in track)
            lines.append(f"{point} {position[0]:.17g} {position[1]:.17g} {position[2]:.17g} 128 128 128 0.5 {places}")
    (folder / "sparse" / "cameras.txt").write_text("\n".join(cameras) + "\n", encoding="utf-8")
    (folder / "sparse" / "images.txt").write_text("\n".join(images) + "\n", encoding="utf-8")
    (folder / "sparse" / "points3D.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "stereo" / "patch-match.cfg").write_text("".join(f"{n}\n__auto__, 12\n" for n in names), encoding="utf-8")
    (folder / "stereo" / "fusion.cfg").write_text("".join(f"{n}\n" for n in names), encoding="utf-8")


def external_points(backend: str, views: Views, masks: Sequence[Array], points: Array, threads: int) -> tuple[Array, Array]:
    """Dense points of an external program.

    Args:
        backend: `pycolmap` or `openmvs`.
        views, masks: Photos and masks. [H, W] each.
        points: Points on the object, m. [N, 3].
        threads: Threads to use.

    Returns:
        Points and unit normals in the table frame. [N, 3], [N, 3].

    Raises:
        StageError: The program failed or left no points.
    """
    import trimesh

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_colmap_workspace(views, masks, folder, points)
        result = folder / "fused.ply"
        if backend == "pycolmap":
            import pycolmap

            pycolmap.patch_match_stereo(str(folder))
            pycolmap.stereo_fusion(str(result), str(folder))
        else:
            programs = openmvs_binaries() or {}
            scene, dense = folder / "scene.mvs", folder / "fused.mvs"
            steps = (
                ("InterfaceCOLMAP", "-i", str(folder), "-o", str(scene), "--image-folder", str(folder / "images")),
                ("DensifyPointCloud", str(scene), "-o", str(dense), "--max-threads", str(threads)),
            )
            for program, *arguments in steps:
                done = subprocess.run([programs[program], *arguments, "-w", name], capture_output=True, text=True, check=False)
                if done.returncode != 0:
                    tail = (done.stderr or done.stdout).strip().splitlines()[-1:] or ["no message"]
                    raise StageError("mesh", f"{program} failed ({tail[0]})", "Use mesh.backend: sweep")
        if not result.is_file():
            raise StageError("mesh", f"{backend} left no points", "Use mesh.backend: sweep")
        cloud: Any = trimesh.load(str(result), process=False)
        data = cloud.metadata.get("_ply_raw", {}).get("vertex", {}).get("data")
        found = np.asarray(cloud.vertices, dtype=np.float64)
        if data is None or "nx" not in data.dtype.names or len(found) < 100:
            raise StageError("mesh", f"{backend} left {len(found)} points with normals", "Use mesh.backend: sweep")
        normals = np.stack([np.asarray(data[key], dtype=np.float64).ravel() for key in ("nx", "ny", "nz")], axis=1)
    return found, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
