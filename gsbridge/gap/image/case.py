"""A user's case of camera images: the YAML file that names model and photos, and the file into which photos are packed."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.registry import read_names
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.gap.formats.yaml_file import read_case_file
from gsbridge.gap.image.diagnose import few_photos, unsteady
from gsbridge.gap.image.doubts import shared_photos
from gsbridge.gap.image.files import REGISTRATION, read_pairs, read_splat_pairs
from gsbridge.gap.image.pairs import Pairs
from gsbridge.geometry import Array
from gsbridge.sim.model import read_model

PHOTOS = "photos"
"""Name of the section that marks a case as one of camera images; also its mode in `records.json`."""

_PAGE = "docs/gap_images.md"
_KEYS = ("model", PHOTOS, "effects")
_FOLDERS = ("views", "before", "after")
_DRAWN = ("views", REGISTRATION, "after")
_ARRAYS = ("before", "again", "after", "depths", "poses")


@dataclass(frozen=True)
class ImageCase:
    """A checked case of camera images.

    Args:
        model: Model file of the simulation, to which the named effects are added.
        pairs: Photos by role.
        names: Effects among which the diagnosis searches; None for all.
        reasons: Reasons why the result is degraded; empty if it is not.
        registration: Rendered images and photos of the registration's day, when all was well, if photos are compared with
            rendered images; None if they are compared with earlier photos of the same views.
    """

    model: Path
    pairs: Mapping[str, Pairs]
    names: tuple[str, ...] | None
    reasons: tuple[str, ...]
    registration: Pairs | None = None


def read_image_case(path: str | Path) -> ImageCase:
    """Read and check a case of camera images.

    Raises:
        InputError: The file, the simulation's model or the photos cannot be used.
    """
    path = Path(path)
    content = read_case_file(path, _PAGE, PHOTOS, _KEYS)
    given = content[PHOTOS]
    folders = _DRAWN if REGISTRATION in given else _FOLDERS
    for key in given:
        if key not in (*folders, "shot"):
            raise InputError(path, f"the key 'photos.{key}' is unknown", f"Use only: {', '.join(folders)}, shot")
    for key in folders:
        if not isinstance(given.get(key), str):
            raise InputError(path, f"'photos.{key}' names no folder", f"See {_PAGE}")
    shot = given.get("shot", 0)
    if isinstance(shot, bool) or not isinstance(shot, int) or shot < 0:
        raise InputError(path, f"'photos.shot' is {shot!r}", "Give the number of the later photo that counts: 0, 1, ...")
    model = path.parent / str(content["model"])
    read_model(model)
    names = read_names(content.get("effects"), path, IMAGE_EFFECTS)
    places = [path.parent / given[key] for key in folders]
    if folders is _DRAWN:
        registration, later = read_splat_pairs(*places, shot=shot)
        reasons = (*few_photos(registration), *shared_photos(later))
        return ImageCase(model, later, names, reasons, registration)
    pairs = read_pairs(*places, shot=shot)
    return ImageCase(model, pairs, names, (*unsteady(pairs), *shared_photos(pairs)))


def save_pairs(path: str | Path, pairs: Mapping[str, Pairs]) -> None:
    """Write photos that were read from files into one file, atomically.

    Args:
        path: File to write (`.npz`).
        pairs: Photos by role, taken by a camera at rest: tracks and times are not stored.
    """
    arrays: dict[str, Array] = {}
    plain = {}
    for role, part in pairs.items():
        plain[role] = {"camera": part.camera.to_json(), "repeats": part.repeats, "name": part.name, "digest": part.digest}
        plain[role] |= {"drawn": part.drawn}
        arrays |= {f"{role}/{name}": getattr(part, name) for name in _ARRAYS}
    with atomic_file(path) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, plain=json.dumps(plain), **arrays)  # type: ignore[arg-type]


def load_pairs(path: str | Path) -> dict[str, Pairs]:
    """Read the photos that `save_pairs` wrote.

    Raises:
        InputError: The file is missing or damaged.
    """
    try:
        with np.load(path) as data:
            return {
                role: Pairs(
                    Camera.from_json(about.pop("camera")), *(data[f"{role}/{name}"] for name in _ARRAYS), **about
                )
                for role, about in json.loads(str(data["plain"])).items()
            }  # fmt: skip
    except (OSError, EOFError, KeyError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(
            path, f"the stored photos cannot be read ({error})", "Delete the file and run the rule again"
        ) from error
