"""Doubts about photos that a diagnosis would take at their word: copies, poses of another convention, unusable depths."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.residuals import compared, shrunk
from gsbridge.geometry import Array

_PAGE = "docs/gap_images.md"

_LEAST = 0.02
"""Share of a role's pixels that must be comparable for a diagnosis to mean anything."""

_ROWS = 60
"""Approximate height, px, to which photos are reduced before their poses are tested."""
_MOST = 12
"""Largest number of views that are compared with each other to test their poses."""
_OVERLAP = 0.25
"""Share of a view's pixels that another view must show for the two to be compared."""
_FEWEST = 3
"""Fewest pairs of views that must overlap for a judgement about their poses."""
_AGREES = 0.5
"""Correlation of photos, moved into each other's view, from which on poses and depths are taken to be right."""
_BETTER = 2.0
"""Factor by which another reading of the poses must agree better than the stated one before the stated one is refused."""
_ALIKE = 0.8
"""Correlation of photos from one and the same pose; photos of different things from one pose agree less."""

_SLIGHT = 0.02
"""Mean difference of photos, of the range 0..1, that counts as none: pictures of a bare wall do not correlate."""

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class _Reading:
    """A way to read the stated poses and depths.

    Args:
        problem: What the user has given, if this reading is the right one.
        inverted: Whether the stated poses are `world_from_cam`.
        flipped: Whether the stated cameras have OpenGL's axes.
        unit: Unit of the stated translations, m.
        depth_unit: Unit of the stated depths, m.
    """

    problem: str
    inverted: bool = False
    flipped: bool = False
    unit: float = 1.0
    depth_unit: float = 1.0

    def poses(self, stated: Array) -> Array:
        """Return `cam_from_world` of OpenCV's cameras, in metres. [N, 4, 4] -> [N, 4, 4]."""
        out = stated.copy()
        out[:, :3, 3] *= self.unit
        out = np.linalg.inv(out) if self.inverted else out
        return _FLIP @ out if self.flipped else out


_STATED = _Reading("")
_GL, _INVERSE, _MM = "OpenGL's axes (y up, z backwards)", "world_from_cam", "millimetres"
_OTHERS = (
    _Reading(f"they seem to have {_GL}", flipped=True),
    _Reading(f"they seem to be {_INVERSE}", inverted=True),
    _Reading(f"they seem to be {_INVERSE}, with {_GL}", inverted=True, flipped=True),
    _Reading(f"their translations seem to be in {_MM}", unit=1e-3),
    _Reading(f"they seem to be in {_MM}, with {_GL}", flipped=True, unit=1e-3),
    _Reading(f"they seem to be {_INVERSE}, in {_MM}", inverted=True, unit=1e-3),
    _Reading(f"they seem to be {_INVERSE}, in {_MM}, with {_GL}", inverted=True, flipped=True, unit=1e-3),
    _Reading(f"the depths seem to be in {_MM}", depth_unit=1e-3),
)


def check_compared(pairs: Mapping[str, Pairs]) -> None:
    """Refuse photos of which hardly a pixel can be compared.

    Args:
        pairs: Photos by role.

    Raises:
        InputError: Nearly all pixels of a role lie near steps or gaps of the depth.
    """
    for role, part in pairs.items():
        share = float(compared(part).mean())
        if share < _LEAST:
            raise InputError(
                part.name or f"photos of '{role}'",
                f"only {100 * share:.1f} % of the pixels can be compared: the depths of the others are unknown, or differ from "
                "pixel to pixel as at the edge of a thing",
                f"Smooth the depths of surfaces to about 0.1 %, or render them from a mesh; see {_PAGE}",
            )


def check_poses(pairs: Mapping[str, Pairs], source: str | Path) -> None:
    """Refuse poses and depths by which no photo fits another, if another convention or unit makes them fit.

    Each photo is moved into the other views by its depths. Where the views overlap, the result should look like the photo taken
    there.

    Args:
        pairs: Photos by role.
        source: File of the poses, for messages.

    Raises:
        InputError: Another reading of poses and depths fits, or all poses are equal although the photos show different things.
    """
    camera = next(iter(pairs.values())).camera
    size = max(1, round(camera.height / _ROWS))
    grey = np.concatenate([shrunk(part.before.mean(axis=-1), size) for part in pairs.values()])
    tall, wide = grey.shape[1:]
    middle = slice(size // 2, None, size)
    depths = np.concatenate([part.depths[:, middle, middle][:, :tall, :wide] for part in pairs.values()])
    poses = np.concatenate([part.poses for part in pairs.values()])
    chosen = np.unique(np.linspace(0, len(poses) - 1, _MOST).round().astype(int))
    grey, depths, poses = grey[chosen], np.nan_to_num(depths[chosen], nan=0.0, posinf=0.0), poses[chosen]
    if np.abs(poses - poses[0]).max() < 1e-9:
        differ = [
            _correlation(one.ravel(), other.ravel()) < _ALIKE and float(np.abs(one - other).mean()) > _SLIGHT
            for one, other in itertools.combinations(grey, 2)
        ]
        if np.mean(differ) > 0.5:
            raise InputError(
                source, "all views have one and the same pose, but their photos differ", "Give the pose of each view"
            )
        return
    rays = camera.pixel_rays()[middle, middle][:tall, :wide]
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy]) / size
    stated = _agreement(_STATED, grey, depths, poses, rays, lens)
    if stated >= _AGREES:
        return
    found = {reading: _agreement(reading, grey, depths, poses, rays, lens) for reading in _OTHERS}
    best = max(found, key=lambda reading: found[reading])
    if found[best] >= _AGREES and found[best] > _BETTER * stated:
        raise InputError(
            source,
            f"by their poses the photos do not fit each other (correlation {stated:.2f}); {best.problem} ({found[best]:.2f})",
            f"Give cam_from_world with OpenCV's axes (x right, y down, z forwards), all lengths in metres; see {_PAGE}",
        )


def _agreement(reading: _Reading, grey: Array, depths: Array, poses: Array, rays: Array, lens: Array) -> float:
    """Return the mean correlation of photos with others that were moved into their views; 0 if too few views overlap.

    Args:
        reading: How poses and depths are read.
        grey: Photos. [N, h, w].
        depths: Depths as stated, 0 where unknown. [N, h, w].
        poses: Poses as stated. [N, 4, 4].
        rays: Viewing rays of the pixels, z = 1. [h, w, 3].
        lens: `fx, fy, cx, cy` of the reduced photos, px.
    """
    found = list(_pairwise(grey, depths * reading.depth_unit, reading.poses(poses), rays, lens))
    return max(float(np.mean(found)), 0.0) if len(found) >= _FEWEST else 0.0


def _pairwise(grey: Array, depths: Array, poses: Array, rays: Array, lens: Array) -> Iterator[float]:
    """Yield the correlation of each two views that overlap; see `_agreement`."""
    fx, fy, cx, cy = lens
    tall, wide = grey.shape[1:]
    for one, other in itertools.permutations(range(len(grey)), 2):
        other_from_one = poses[other] @ np.linalg.inv(poses[one])
        places = (rays * depths[one][..., None]) @ other_from_one[:3, :3].T + other_from_one[:3, 3]
        deep = np.maximum(places[..., 2], 1e-9)
        # OpenCV puts the centre of the first pixel at zero.
        across = np.clip(fx * places[..., 0] / deep + cx - 0.5, -1e4, 1e4).astype(np.float32)
        down = np.clip(fy * places[..., 1] / deep + cy - 0.5, -1e4, 1e4).astype(np.float32)
        seen = (
            (depths[one] > 0) & (places[..., 2] > 0) & (across >= 0) & (across <= wide - 1) & (down >= 0) & (down <= tall - 1)
        )
        if seen.mean() >= _OVERLAP:
            moved = cv2.remap(grey[other].astype(np.float32), across, down, cv2.INTER_LINEAR)
            yield _correlation(grey[one][seen], moved[seen])


def _correlation(one: Array, other: Array) -> float:
    """Return Pearson's correlation of two samples; 0 if one of them is constant. [K], [K]."""
    a, b = one - one.mean(), other - other.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0 else 0.0


def shared_photos(pairs: Mapping[str, Pairs]) -> tuple[str, ...]:
    """Warn, in words, of pictures that stand for more than one view: effects would be judged on the photos they were fitted to.

    Args:
        pairs: Photos by role.
    """
    out = []
    known: dict[bytes, str] = {}
    for role, part in pairs.items():
        for photo, earlier in zip(part.after, part.before, strict=True):
            digest = hashlib.sha256(np.ascontiguousarray(photo).tobytes()).digest()
            first = known.get(digest)
            if first is not None:
                where = f"'{first}' and '{role}'" if first != role else f"two views of '{role}'"
                out.append(f"{where} share a picture, so that it proves nothing: take other photos")
            if not part.drawn and np.array_equal(photo, earlier):
                out.append(f"a later photo of '{role}' is a copy of an earlier one")
            known.setdefault(digest, role)
    return tuple(dict.fromkeys(out))


def check_repeats(photos: Mapping[Path, Array]) -> None:
    """Refuse earlier photos of a view that are copies: the noise is learnt from their differences.

    Args:
        photos: Earlier photos of one view, by their files. [H, W, 3] each.

    Raises:
        InputError: Two of them have the same pixels.
    """
    for (first, one), (second, other) in itertools.combinations(photos.items(), 2):
        if np.array_equal(one, other):
            raise InputError(
                second,
                f"it is the same picture as {first.name}, so it says nothing about the noise",
                "Take each photo anew, before anything changes",
            )
