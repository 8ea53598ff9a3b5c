"""Which files a capture consists of, and digests of their contents: a folder's date tells nothing about them."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterable
from pathlib import Path

from gsbridge.files import write_json
from gsbridge.reading import files_below

_REMEDY = "Name the folder in which the photos lie"


def capture_files(kind: str, path: Path) -> list[Path]:
    """Files that the reader of a capture opens; `path` itself is not among them if it is a file.

    Args:
        kind: Kind of the source: `images`, `colmap`, `nerfstudio`, `video`.
        path: File or folder of the source.

    Raises:
        InputError: The folder holds so many files that it cannot be a capture.
    """
    if kind == "nerfstudio":
        return _listed_photos(path)
    if not path.is_dir():
        return []
    files = files_below(path, ("",), "capture", _REMEDY)
    if kind == "colmap":
        # The reader looks for photos in these places, too, if they do not lie in the model's folder.
        places = (place / "images" for place in (path, path.parent, path.parent.parent))
        photos = next((place for place in places if place.is_dir()), None)
        if photos is not None and photos.parent != path:
            files += files_below(photos, ("",), "capture", _REMEDY)
    return files


def _listed_photos(path: Path) -> list[Path]:
    """Photos that a `transforms.json` names; none if it cannot be read, which its reader reports later."""
    try:
        frames = json.loads(path.read_text(encoding="utf-8"))["frames"]
        names = [path.parent / str(frame["file_path"]) for frame in frames]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []
    # Some exporters leave the suffix out.
    found = {file for name in names for file in ([name] if name.is_file() else name.parent.glob(f"{name.name}.*"))}
    return sorted(file for file in found if file.is_file())


def content_digests(files: Iterable[Path], folder: Path, store: Path) -> list[tuple[str, str]]:
    """Names and digests of files; only files whose size or date has changed since the last call are read again.

    Args:
        files: The files; hidden ones do not count.
        folder: Folder that the names are relative to.
        store: File that remembers sizes, dates and digests; it saves time and does not change the result.
    """
    try:
        known = json.loads(store.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        known = {}
    now = {}
    for file in files:
        if file.name.startswith("."):
            continue
        status = file.stat()
        seen = known.get(os.path.relpath(file, folder))
        digest = seen[2] if seen and seen[:2] == [status.st_size, status.st_mtime_ns] else _digest(file)
        now[os.path.relpath(file, folder)] = [status.st_size, status.st_mtime_ns, digest]
    if now != known and store.parent.parent.is_dir():
        # The store only saves time: a folder that may not be written is no reason to stop.
        with contextlib.suppress(OSError):
            write_json(store, now)
    return sorted((name, str(seen[2])) for name, seen in now.items())


def _digest(file: Path) -> str:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()[:16]
