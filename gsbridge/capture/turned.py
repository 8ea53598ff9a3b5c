"""Keyframes in quarter turns: what a reconstruction makes of photos that are stored turned."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import atomic_directory, read_json, write_json
from gsbridge.images import image_size, read_image_u8, write_image


def turn_keyframes(frames: Path, keyframes: Path, degrees: int, out_frames: Path, out_keyframes: Path) -> None:
    """Write all keyframes of a capture turned counter-clockwise, with their record.

    Args:
        frames: Folder of the keyframes.
        keyframes: Their record.
        degrees: 0, 90, 180 or 270.
        out_frames: Folder of the turned keyframes.
        out_keyframes: Their record, with width and height exchanged where the turn exchanges them.

    Raises:
        InputError: A keyframe or the record is damaged, or the photos come with cameras, which would have to be turned, too.
    """
    record = read_json(keyframes)
    if record.get("known_cameras"):
        raise InputError(keyframes, "its photos come with cameras, which are not turned", "Turn photos without cameras")
    with atomic_directory(out_frames) as folder:
        for frame in record["frames"]:
            write_image(folder / frame["name"], np.rot90(read_image_u8(frames / frame["name"]), degrees // 90))
    if degrees % 180:
        record |= {"width": record["height"], "height": record["width"]}
        record["frames"] = [
            # Photos of another size than most state their own.
            {**frame, "size": frame["size"][::-1]} if "size" in frame else frame
            for frame in record["frames"]
        ]
    write_json(out_keyframes, record)


def turn_length(length: Mapping[str, Any] | None, degrees: int, frames: Path) -> dict[str, Any] | None:
    """Turn the pixels of a known length like the photos that they lie in.

    Args:
        length: The setting `known_length` of a scene.
        degrees: See `turn_keyframes`.
        frames: Folder of the keyframes before the turn, whose sizes are needed.

    Returns:
        The same length in pixels of the turned keyframes.

    Raises:
        InputError: A keyframe that the length names is damaged.
    """
    if length is None:
        return None
    if "between" not in length:
        return dict(length)
    return {**length, "between": [_turned_end(end, degrees, frames) for end in length["between"]]}


def _turned_end(end: tuple[str, float, float], degrees: int, frames: Path) -> list[Any]:
    """Turn one end of a length; u counts to the right and v downwards, from the photo's upper left corner."""
    name, u, v = end
    width, height = image_size(frames / name)
    turned = {0: (u, v), 90: (v, width - u), 180: (width - u, height - v), 270: (height - v, u)}
    return [name, *turned[degrees]]
