"""Cases of photos as files: what a diagnosis gets, what is hidden from it, and how much of the gap its findings close."""

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
"""Effects whose hidden size is a parameter of the diagnosis, too, though by another formulation; of the others no interval is
judged."""


def write_photos(folder: Path, pairs: Mapping[str, Pairs]) -> dict[str, str]:
    """Write the photos of a case. Returns the files' SHA-256 by role.

    Args:
        folder: Folder of the case, which exists already.
        pairs: Photos by role, of 8 bits; `again` is a mean over some.
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
    """Whole numbers per unit of brightness in which photos are stored: 8 bits, and a sum of such photos."""
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
    """Share of the gap that effects close on `verify` against photos without noise, and what is left in units of the noise.

    As for motion: 1 - (after - floor) / (before - floor), the floor being the gap where nothing is hidden, which is that of the
    noisy earlier photos themselves, and is no part of what is left. None where what is hidden leaves photos without noise as
    they were: noise does.

    Args:
        folder: Folder of the case.
        clean: Photos of `verify` with what is hidden. [N, H, W, 3].
        plain: The same photos with nothing hidden. [N, H, W, 3].
        effects: Effects that were named.
    """
    pairs = read_photos(folder)
    noise = learn_noise(list(pairs.values()))

    def gap(photos: Array, with_effects: Sequence[Applied]) -> float:
        view = ImageResiduals(replace(pairs["verify"], after=photos.astype(np.float32)), noise, compare_noise=False)
        return float(np.sqrt((view.residual(with_effects).astype(np.float64) ** 2).mean()))

    floor, before, after = gap(plain, ()), gap(clean, ()), gap(clean, effects)
    closure = 1.0 - max(after - floor, 0.0) / (before - floor) if before > floor else None
    return closure, float(np.sqrt(max(after**2 - floor**2, 0.0)))


def contents_of(photos: Sequence[str | Path], renders: Sequence[str | Path], few: int = 4) -> tuple[tuple[Array, ...], ...]:
    """Pictures that may lie on the tables of the worlds, in turn: none, photos, renders of splats. Where there are none of a
    kind, its worlds are painted, and the others stay as they are.

    Args:
        photos: Folders of photos.
        renders: Folders of renders.
        few: Pictures taken from each folder.

    Raises:
        InputError: A folder holds no picture.
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
