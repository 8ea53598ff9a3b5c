"""Photos of two days as files: a folder that describes the views, and a folder of photos for each day.

| path | content |
|---|---|
| `views.json` | `camera` (width, height, fx, fy, cx, cy in px) and `views`, each with `name`, `role`, `cam_from_world` |
| `depths.npz` | `depths`: camera z of every pixel, m, 0 where unknown. [N, H, W] |
| `before/{name}_{k}.png` | photos while all was well, k = 0, 1, ...; two or more of each view |
| `after/{name}_{k}.png` | later photos of the same views; one of them is diagnosed, by default k = 0 |

Later photos can also be compared with rendered images instead of earlier photos. The folder of views then holds the rendering
of each view, `{name}.png`, and another folder holds photos of some views from the registration's day, `{name}_0.png`.
"""

from __future__ import annotations

import hashlib
import math
import re
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.cameras import Camera, given_camera
from gsbridge.errors import InputError
from gsbridge.gap.diagnosis.results import ROLES
from gsbridge.gap.image.doubts import check_compared, check_poses, check_repeats
from gsbridge.gap.image.pairs import Pairs
from gsbridge.geometry import Array
from gsbridge.given import read_given_json
from gsbridge.images import read_image
from gsbridge.reading import refusing, regular_file
from gsbridge.tasks.views import DEPTHS, VIEWS

_PAGE = "See docs/gap_images.md"
_PICTURES = (".png", ".jpg", ".jpeg", ".heic", ".webp", ".tif", ".tiff", ".bmp")

_MEMBER = "depths.npy"
_LARGEST_NUMBER = 16
"""Size of the widest number type in which depths may be stored, bytes."""
_HEADER = 2**20
"""Allowance for headers and other content of the depth file, bytes."""

REGISTRATION = "registration"
"""Role of views that were photographed only on the registration's day, when all was well."""


def read_pairs(views: str | Path, before: str | Path, after: str | Path, *, shot: int = 0) -> dict[str, Pairs]:
    """Read earlier and later photos of the same views.

    Args:
        views: Folder of `views.json` and `depths.npz`.
        before: Folder of earlier photos. The first photo of each view is compared; the others are used to learn the noise.
        after: Folder of later photos. It may be the same folder, for a control without any change.
        shot: Number of the later photo of each view that is diagnosed. If both folders are the same, this photo is left out of
            the earlier ones.

    Raises:
        InputError: A file is missing, damaged or of the wrong size; the message names it.
    """
    views, before, after = Path(views), Path(before), Path(after)
    camera, rows, depths = read_views(views)
    same = before.resolve() == after.resolve()
    out: dict[str, Pairs] = {}
    for role, chosen in _by_role(rows, views).items():
        first, again, later, repeats, digest = [], [], [], set(), hashlib.sha256()
        for index in chosen:
            name = rows[index]["name"]
            taken = _shots(before, name)
            shots = [path for number, path in sorted(taken.items()) if not (same and number == shot)]
            if len(shots) < 2:
                raise InputError(
                    before,
                    f"there are {len(shots)} photos of the view '{name}'{_misnamed(before, name)}",
                    f"Take two or more before anything changes, and call them {name}_0.png, {name}_1.png, ...",
                )
            paths = [*shots, after / f"{name}_{shot}.png"]
            photos = [_photo(path, camera) for path in paths]
            check_repeats(dict(zip(shots, photos, strict=False)))
            for path in paths:
                digest.update(path.read_bytes())
            first.append(photos[0])
            again.append(np.mean(photos[1:-1], axis=0, dtype=np.float64).astype(np.float32))
            later.append(photos[-1])
            repeats.add(len(shots) - 1)
        if len(repeats) > 1:
            raise InputError(
                before,
                f"some views have {min(repeats) + 1} photos, others {max(repeats) + 1}",
                "Take the same number of each",
            )
        poses = np.stack([rows[index]["cam_from_world"] for index in chosen])
        digest.update(depths[chosen].tobytes() + poses.tobytes())
        out[role] = Pairs(
            camera, np.stack(first), np.stack(again), np.stack(later), depths[chosen], poses,
            repeats=repeats.pop(), name=f"{before}, {role}", digest=digest.hexdigest(),
        )  # fmt: skip
    check_compared(out)
    check_poses(out, views / VIEWS)
    return out


def read_splat_pairs(
    views: str | Path, registration: str | Path, after: str | Path, *, shot: int = 0
) -> tuple[Pairs, dict[str, Pairs]]:
    """Read rendered images, photos of the registration's day, and later photos.

    Args:
        views: Folder of `views.json`, `depths.npz` and the rendered image of each view, `{name}.png`.
        registration: Folder of photos taken while all was well, `{name}_0.png`; views without such a photo are skipped.
        after: Folder of later photos, with one of each view whose role is `fit`, `select` or `verify`.
        shot: Number of the later photo of each view that is diagnosed.

    Returns:
        Rendered images (`before`) and photos (`after`) of the registration's day; and the same for the later photos, by role.

    Raises:
        InputError: A file is missing, damaged or of the wrong size; the message names it.
    """
    views, registration, after = Path(views), Path(registration), Path(after)
    camera, rows, depths = read_views(views)
    early = [index for index, row in enumerate(rows) if (registration / f"{row['name']}_0.png").is_file()]
    if not early:
        raise InputError(registration, "it holds no photo of a view", f"Name them after the views, with _0.png. {_PAGE}")

    def drawn(chosen: Sequence[int], folder: Path, number: int, name: str) -> Pairs:
        paths = [folder / f"{rows[index]['name']}_{number}.png" for index in chosen]
        pictures = [views / f"{rows[index]['name']}.png" for index in chosen]
        first, later = (np.stack([_photo(path, camera) for path in some]) for some in (pictures, paths))
        poses = np.stack([rows[index]["cam_from_world"] for index in chosen])
        digest = hashlib.sha256(b"".join(path.read_bytes() for path in (*pictures, *paths)))
        digest.update(depths[list(chosen)].tobytes() + poses.tobytes())
        return Pairs(
            camera, first, first, later, depths[list(chosen)], poses,
            name=f"{folder}, {name}", digest=digest.hexdigest(), drawn=True,
        )  # fmt: skip

    later = {role: drawn(chosen, after, shot, role) for role, chosen in _by_role(rows, views).items()}
    check_compared(later)
    check_poses(later, views / VIEWS)
    return drawn(early, registration, 0, "registration"), later


def read_views(views: Path) -> tuple[Camera, Sequence[dict[str, Any]], Array]:
    """Read the camera, the rows of the views (name, role and pose), and their depths, m. [N, H, W]."""
    content = read_given_json(views / VIEWS, f"Draw the views again, or correct the case. {_PAGE}")
    camera, rows = _camera(content, views / VIEWS), _rows(content, views / VIEWS)
    return camera, rows, _depths(views / DEPTHS, (len(rows), camera.height, camera.width))


def _by_role(rows: Sequence[dict[str, Any]], views: Path) -> dict[str, list[int]]:
    """Return the row numbers of the views of each role."""
    out = {role: [index for index, row in enumerate(rows) if row["role"] == role] for role in ROLES}
    for role, chosen in out.items():
        if not chosen:
            raise InputError(views / VIEWS, f"no view has the role '{role}'", _PAGE)
    return out


def _shots(folder: Path, name: str) -> dict[int, Path]:
    """Return the photos of a view by their number.

    Raises:
        InputError: The folder does not exist, or two photos have the same number.
    """
    if not folder.is_dir():
        raise InputError(folder, "the folder of photos does not exist", f"Correct its name. {_PAGE}")
    pattern, out = re.compile(re.escape(name) + r"_(\d+)\.png"), {}
    for path in sorted(folder.iterdir()):
        found = pattern.fullmatch(path.name)
        if found is None:
            continue
        if int(found[1]) in out:
            raise InputError(path, f"two photos of the view '{name}' have the number {int(found[1])}", "Number them 0, 1, ...")
        out[int(found[1])] = path
    return out


def _misnamed(folder: Path, name: str) -> str:
    """Say which file of the folder looks like a photo of a view, but is not called like one; empty if none does."""
    near = [path.name for path in sorted(folder.iterdir()) if path.name.startswith(name) and path.suffix.lower() in _PICTURES]
    wrong = [file for file in near if not re.fullmatch(re.escape(name) + r"_\d+\.png", file)]
    return f"; {wrong[0]} is not called as they must be" if wrong else ""


def _camera(content: Any, source: Path) -> Camera:
    given = content.get("camera") if isinstance(content, dict) else None
    wanted = tuple(Camera(1, 1, 1.0, 1.0, 0.0, 0.0).to_json())
    if not isinstance(given, dict):
        raise InputError(source, "its 'camera' is no camera", f"Give {', '.join(wanted[:-1])} in pixels. {_PAGE}")
    for key in given:
        if key not in wanted:
            raise InputError(source, f"'{key}' is no key of its 'camera'", f"Give only {', '.join(wanted)}. {_PAGE}")
    return given_camera(given, source, "Give width, height, fx, fy, cx, cy in pixels")


def _rows(content: Any, source: Path) -> Sequence[dict[str, Any]]:
    """Check the name, role and pose of every view and return them."""
    found = content.get("views")
    if not isinstance(found, list) or not found:
        raise InputError(source, "it lists no 'views'", _PAGE)
    out, names = [], set()
    for number, item in enumerate(found):
        name = str(item.get("name", number)) if isinstance(item, dict) else str(number)
        role = item.get("role") if isinstance(item, dict) else None
        if role not in (*ROLES, REGISTRATION):
            what = "has no role" if role is None else f"has no such role: {role!r}"
            raise InputError(source, f"the view '{name}' {what}", f"Give one of {', '.join(ROLES)}")
        if name in names:
            raise InputError(source, f"two views are called '{name}'", "Give each a name of its own")
        names.add(name)
        if item.get("cam_from_world") is None:
            raise InputError(source, f"the view '{name}' has no pose", "Give its cam_from_world, 4 x 4")
        try:
            pose = np.array(item["cam_from_world"], dtype=np.float64).reshape(4, 4)
        except (TypeError, ValueError) as error:
            raise InputError(source, f"the pose of the view '{name}' is no 4 x 4 matrix", "Give its cam_from_world") from error
        if not _is_rigid(pose):
            raise InputError(
                source, f"the pose of the view '{name}' is no turn and shift", "Give its cam_from_world, in metres, OpenCV axes"
            )
        out.append({"name": name, "role": item["role"], "cam_from_world": pose})
    return out


def _is_rigid(pose: Array) -> bool:
    """Whether a 4 x 4 matrix is a rigid transform: a rotation and a translation."""
    turn = pose[:3, :3]
    return bool(
        np.isfinite(pose).all()
        and np.allclose(turn @ turn.T, np.eye(3), atol=1e-3)
        and np.linalg.det(turn) > 0
        and np.allclose(pose[3], (0.0, 0.0, 0.0, 1.0), atol=1e-6)
    )


def _depths(path: Path, shape: tuple[int, int, int]) -> Array:
    largest = math.prod(shape) * _LARGEST_NUMBER + _HEADER
    regular_file(path, "file of the depths", _PAGE, largest)
    with refusing(path, "it holds no depths", _PAGE):
        # A small archive can unpack to gigabytes: check the stated size before unpacking anything.
        with zipfile.ZipFile(path) as archive:
            unpacked = archive.getinfo(_MEMBER).file_size
        if unpacked > largest:
            wanted = " x ".join(map(str, shape))
            raise InputError(path, f"its depths unpack to {unpacked} bytes", f"Give {wanted}: one per view and pixel")
        with np.load(path, allow_pickle=False) as content:
            depths = np.asarray(content[_MEMBER], np.float32)
    if depths.shape != shape:
        seen, wanted = (" x ".join(map(str, size)) for size in (depths.shape, shape))
        raise InputError(path, f"its depths are {seen}", f"Give {wanted}: one per view and pixel")
    if not (np.isfinite(depths) & (depths > 0)).any(axis=(1, 2)).all():
        raise InputError(path, "one view has no depth at any pixel", "Give camera z of what it shows, m; 0 only where unknown")
    return depths


def _photo(path: Path, camera: Camera) -> Array:
    """Read a photo of the camera's size, values 0..1. [H, W, 3] float32."""
    image = np.asarray(read_image(path), np.float32)
    if image.shape != (camera.height, camera.width, 3):
        seen = f"{image.shape[1]} x {image.shape[0]}"
        raise InputError(path, f"the photo is {seen} pixels", f"The camera of views.json has {camera.width} x {camera.height}")
    return image
