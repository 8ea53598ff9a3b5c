"""Cases of photos: their files, the share of the gap that findings close on them, and images for the tables of the worlds."""

from __future__ import annotations

import hashlib
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.gap.diagnosis.results import ROLES
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.residuals import ImageResiduals, learn_noise
from gsbridge.geometry import Array
from gsbridge.images import read_image
from gsbridge.scene.track import Track

CAMERA_FILE = "camera.json"

SAME = {
    "exposure": "stops",
    "black_level": "level",
    "saturation": "change",
    "response": "curve",
    "focal": "change",
    "motion_blur": "exposure_time",
    "latency": "delay",
    "rolling_shutter": "row_time",
}
"""Effects whose hidden size is also a parameter of the diagnosis, in spite of another formulation, with that parameter. The
intervals of other effects are not judged."""


def write_photos(folder: Path, pairs: Mapping[str, Pairs]) -> dict[str, str]:
    """Write the photos of a case, and return the files' SHA-256 by role.

    Args:
        folder: Existing folder of the case.
        pairs: Photos by role, with 8 bits; `again` is the mean of `repeats` such photos.
    """
    digests = {}
    for role, views in pairs.items():
        path = folder / f"{role}.npz"
        moving: dict[str, Any] = {}
        if views.track is not None:
            moving |= {"track_times": views.track.times, "track_poses": views.track.poses}
        moving |= {} if views.times is None else {"times": views.times}
        np.savez_compressed(
            path,
            **{
                name: np.round(getattr(views, name) * scale).astype(np.uint16) for name, scale in _scales(views.repeats).items()
            },
            depths=views.depths.astype(np.float32),
            poses=views.poses,
            repeats=np.array(views.repeats),
            **moving,
        )
        digests[role] = hashlib.sha256(path.read_bytes()).hexdigest()
        camera = views.camera
    write_json(folder / CAMERA_FILE, camera.to_json())
    return digests


def _scales(repeats: int) -> dict[str, int]:
    """Return the integer scales in which photos are stored: 255 for 8 bits, and `repeats` times as much for their mean."""
    return {"before": 255, "again": 255 * repeats, "after": 255}


def read_photos(folder: str | Path) -> dict[str, Pairs]:
    """Read photos that `write_photos` wrote.

    Raises:
        InputError: A file is missing or damaged.
    """
    folder = Path(folder)
    camera = Camera.from_json(read_json(folder / CAMERA_FILE))
    return {role: _pairs(folder / f"{role}.npz", camera, role) for role in ROLES}


def _pairs(path: Path, camera: Camera, role: str) -> Pairs:
    try:
        with np.load(path) as file:
            content = {name: file[name] for name in file.files}
        repeats = int(content["repeats"])
        track = Track(content["track_times"], content["track_poses"]) if "track_times" in content else None
        pictures = [content[name].astype(np.float32) / scale for name, scale in _scales(repeats).items()]
        return Pairs(
            camera, pictures[0], pictures[1], pictures[2],
            content["depths"], content["poses"], track, content.get("times"), repeats, role,
            hashlib.sha256(path.read_bytes()).hexdigest(),
        )  # fmt: skip
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(path, f"the photos cannot be read ({error})", "Generate the cases again") from error


def photo_closure(folder: str | Path, clean: Array, plain: Array, effects: Sequence[Applied]) -> tuple[float | None, float]:
    """Return the share of the gap to noise-free photos of `verify` that effects close, and what remains, in units of the noise.

    As for motion, the share is 1 - (after - floor) / (before - floor). The floor is the gap with nothing hidden, which is due
    to the noise of the earlier photos; it is not counted in what remains. The share is None if the hidden effects do not
    change noise-free photos, as additional noise does not.

    Args:
        folder: Folder of the case.
        clean: Noise-free photos of `verify` with the hidden effects. [N, H, W, 3].
        plain: The same photos without the hidden effects. [N, H, W, 3].
        effects: Named effects.
    """
    pairs = read_photos(folder)
    noise = learn_noise(list(pairs.values()))

    def gap(photos: Array, with_effects: Sequence[Applied]) -> float:
        view = ImageResiduals(replace(pairs["verify"], after=photos.astype(np.float32)), noise, compare_noise=False)
        return view.size_of(view.residual(with_effects))

    floor, before, after = gap(plain, ()), gap(clean, ()), gap(clean, effects)
    closure = 1.0 - max(after - floor, 0.0) / (before - floor) if before > floor else None
    return closure, float(np.sqrt(max(after**2 - floor**2, 0.0)))


def contents_of(photos: Sequence[str | Path], renders: Sequence[str | Path], few: int = 4) -> tuple[tuple[Array, ...], ...]:
    """Read the sets of images that texture the tables of the worlds, which use them in turn: none, photos, renders of splats.

    If a set is empty, its worlds have painted tables, and the other worlds stay as they are.

    Args:
        photos: Folders of photos.
        renders: Folders of renders.
        few: Largest number of images taken from each folder.

    Raises:
        InputError: A folder holds no image.
    """
    return (), tuple(_pictures(photos, few)), tuple(_pictures(renders, few))


def _pictures(folders: Sequence[str | Path], few: int) -> list[Array]:
    out = []
    for folder in folders:
        paths = sorted(path for path in Path(folder).glob("*.png"))
        if not paths:
            raise InputError(folder, "it holds no picture", "Make its stage again")
        chosen = np.linspace(0, len(paths) - 1, min(few, len(paths))).round().astype(int)
        out += [np.asarray(read_image(paths[k]), np.float32) for k in chosen]
    return out
