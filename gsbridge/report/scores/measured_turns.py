"""Figures of captures that were reconstructed from turned photos, beside the capture as it is."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.report.scores.score import Figure, over_scenes, single
from gsbridge.report.scores.turned import Reconstruction

_WHERE = "results/scenes/"
_LIMITS = {"sides": (1.0, 3.0), "volume": (3.0, 9.0)}
"""A turn may change the sides of a mesh's box and its volume by so much, or by twice as much as another seed does, but never by
more than the second value, percent."""
_TIMES_NOISE = 2.0
_SAME_PHOTOS = 1
"""Largest number of photos that may register in one reconstruction and not in the other."""
_PHOTO_OR_NUMBER = re.compile(r"\S+\.(?:png|jpg)|\d+(?:\.\d+)?")


def read_turned(path: str) -> tuple[int, Reconstruction, Reconstruction | None]:
    """Read what `gsbridge.report.scores.turned.write_turned_reconstruction` wrote.

    Returns:
        The turn, degrees; what came out of the photos as they are, and of the turned ones, None if a stage refused these.

    Raises:
        InputError: The record is damaged.
    """
    record = read_json(path)
    try:
        turned = None if record["turned"] is None else Reconstruction(**record["turned"])
        return int(record["degrees"]), Reconstruction(**record["usual"]), turned
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(path, f"it is no record of turned photos ({error!r})", "Delete it, and make it again") from error


def differences(usual: Reconstruction, turned: Reconstruction) -> dict[str, float]:
    """Differences between two meshes of the same thing, percent: sides of the upright box round them, and their volumes.

    Where the scale of one of them is unknown, only shapes are compared: how much more one side of the box changes than another,
    and the share of the box that the mesh fills.
    """
    sides = np.array(turned.sides) / np.array(usual.sides)
    scaled = "unknown" not in (usual.scale_source, turned.scale_source)
    volumes = np.array([turned.visual_volume / usual.visual_volume, turned.collision_volume / usual.collision_volume])
    if not scaled:
        volumes = volumes / np.prod(sides)
    return {
        "sides": float(100 * (np.abs(sides - 1).max() if scaled else sides.max() / sides.min() - 1)),
        "volume": float(100 * np.abs(volumes - 1).max()),
    }


def says_the_same(usual: Reconstruction, turned: Reconstruction) -> bool:
    """Whether the stages of both say the same: status, reasons apart from numbers and photos, source of the scale, photos."""

    def plain(reasons: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
        return {stage: sorted(_PHOTO_OR_NUMBER.sub("", text) for text in texts) for stage, texts in reasons.items()}

    return (
        usual.statuses == turned.statuses
        and plain(usual.reasons) == plain(turned.reasons)
        and usual.scale_source == turned.scale_source
        and abs(usual.registered - turned.registered) <= _SAME_PHOTOS
    )


def turn_figures(scenes: Mapping[str, Sequence[str]]) -> dict[str, Figure]:
    """Make the figures of all captures.

    Args:
        scenes: Records of each scene, see `read_turned`. That of 0 degrees, with another seed, gives the noise.

    Raises:
        InputError: A record is damaged.
    """
    if not scenes:
        return {}
    different: dict[str, float] = {}
    largest: dict[str, dict[str, float]] = {"sides": {}, "volume": {}}
    noises: dict[str, dict[str, float]] = {"sides": {}, "volume": {}}
    refused: dict[str, float] = {}
    turns = 0
    for scene, paths in scenes.items():
        records = [read_turned(path) for path in paths]
        again = next((item for degrees, _, item in records if degrees == 0), None)
        usual, limits = records[0][1], {name: low for name, (low, _) in _LIMITS.items()}
        # Another seed that changes what the stages say tells nothing about the noise of a mesh.
        if again is not None and says_the_same(usual, again):
            noise = differences(usual, again)
            for name, (low, high) in _LIMITS.items():
                noises[name][scene] = noise[name]
                limits[name] = min(max(low, _TIMES_NOISE * noise[name]), high)
        turned = [item for degrees, _, item in records if degrees]
        kept = [item for item in turned if item is not None]
        found = [differences(usual, item) for item in kept]
        same = [
            says_the_same(usual, item) and all(changed[name] <= limit for name, limit in limits.items())
            for item, changed in zip(kept, found, strict=True)
        ]
        turns += len(turned)
        different[scene] = float(len(turned) - sum(same))
        refused[scene] = float(len(turned) - len(kept))
        for name in limits:
            if found:
                largest[name][scene] = max(changed[name] for changed in found)
    count = single(sum(different.values()), len(scenes), _WHERE)
    out = {"photos_turns_different": count | {"turns": turns, "by_scene": different, "beside": {"refused": refused}}}
    for name, found_sizes in largest.items():
        if found_sizes:
            beside = {"another seed, not turned": noises[name]} if noises[name] else None
            out[f"photos_turned_{name}_max"] = over_scenes(found_sizes, max, _WHERE, beside=beside)
    return out
