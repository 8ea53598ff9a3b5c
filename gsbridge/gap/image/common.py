"""Ways in which all pictures of a scene are off together: as effects are, and as slopes, brightness and places are.

The same splats are seen in all photos. A splat that is a little off is so in each of them, and more photos do not help: what
effect-free photos show of an effect bounds how small an effect can be told. Each way is a direction in the space of residuals
with a variance of its own, and residuals are weighed by the inverse of the whole covariance (a low-rank update of white noise).
"""

from __future__ import annotations

from itertools import product
from typing import Any, Protocol

import cv2
import numpy as np

from gsbridge.gap.image.model import ImageModel
from gsbridge.gap.image.shots import Shots
from gsbridge.geometry import Array
from gsbridge.scene.effects import catalogue


class Seen(Protocol):
    """What is needed of a `gsbridge.gap.image.view.View`, which stands on this module."""

    model: ImageModel
    shots: Shots
    plain: Any
    flats: Any

    def shooting(self) -> Any:
        """How plain pictures are taken."""

    def residual(self) -> Array:
        """In units of the floor."""

    def white(self, apart: Array, rough: Array) -> Array:
        """Differences in units of the floor."""

    def by_photo(self, table: Array) -> Array:
        """A residual with the numbers of each photo together."""


_ROUNDS = 25
"""Of the search for variances."""


def features(pictures: Array) -> dict[str, Array]:
    """What differences may look like in every colour: slopes, brightness and places. [N, H, W, 3] -> the same by name."""
    height, width = pictures.shape[1:3]
    x, y = np.meshgrid((np.arange(width) + 0.5) / width - 0.5, (np.arange(height) + 0.5) / height - 0.5)
    x, y = (np.broadcast_to(v[None, :, :, None], pictures.shape).astype(np.float32) for v in (x, y))
    across, down, fine = (np.empty_like(pictures) for _ in range(3))
    for n, picture in enumerate(pictures):
        across[n] = cv2.Sobel(picture, cv2.CV_32F, 1, 0, scale=0.125)
        down[n] = cv2.Sobel(picture, cv2.CV_32F, 0, 1, scale=0.125)
        fine[n] = cv2.Laplacian(picture, cv2.CV_32F)
    return {
        "offset": np.ones_like(pictures), "gain": pictures, "square": pictures**2, "x": x, "y": y, "radius": x**2 + y**2,
        "across": across, "down": down, "spread": x * across + y * down, "turn": x * down - y * across,
        "stretch": x * across - y * down, "bend": (x**2 + y**2) * (x * across + y * down), "sharpness": fine,
        "gain x": x * pictures, "gain y": y * pictures, "gain radius": (x**2 + y**2) * pictures,
    }  # fmt: skip


def coloured(shape: Array) -> list[Array]:
    """A feature in one colour at a time. [N, H, W, 3] -> three of these."""
    out = []
    for colour in range(3):
        only = np.zeros_like(shape)
        only[..., colour] = shape[..., colour]
        out.append(only)
    return out


def _waves(height: int, width: int) -> list[Array]:
    """Slow grey waves over the image: light that is uneven in some place. [H, W, 1] each."""
    x, y = (np.arange(width) + 0.5) / width, ((np.arange(height) + 0.5) / height)[:, None]
    orders = [(a, b) for a in range(4) for b in range(4) if 2 <= a + b <= 4]
    return [(np.cos(np.pi * a * x) * np.cos(np.pi * b * y)).astype(np.float32)[..., None] for a, b in orders]


def directions(view: Seen) -> Array:
    """All ways, as white residuals of size one feature or one typical effect, in columns for each photo. [N, D, M] float32."""
    quiet = np.zeros((*view.flats.counts.shape, 3))
    shapes = [only for shape in features(view.plain).values() for only in coloured(shape)]
    shapes += [view.plain * wave for wave in _waves(*view.plain.shape[1:3])]
    for name, effect in catalogue().items():
        if effect.grain or len(effect.amplitudes) < len(effect.parameters) - 2 or effect.places:
            continue
        forms = effect.shapes()[0]
        for parameter, size in product(effect.amplitudes, effect.sizes):
            row = {p.name: forms.get(p.name, 0.0) for p in effect.parameters} | {parameter.name: size * parameter.typical}
            how = view.shooting()
            catalogue()[name].apply(how, row)
            shapes.append(view.model.expected(view.shots, how) - view.plain)
    return np.stack([view.white(shape, quiet) for shape in shapes], axis=2)


def variances(view: Seen, run: int) -> Array:
    """Variance of the amplitude of every way, photo by photo, such that it does not become less by taking several.

    Args:
        view: Effect-free photos, with a floor that knows no common part.
        run: Photos of a role: if each photo's amplitude varies so much more, their mean varies as one photo's does.

    Returns:
        [M].

    Source: Dempster, Laird and Rubin, Journal of the Royal Statistical Society B 39(1), 1977, for variance components.
    """
    table = directions(view)
    along = (table.transpose(0, 2, 1) @ view.by_photo(view.residual())[:, :, None])[:, :, 0].astype(np.float64)
    gram = (table.transpose(0, 2, 1) @ table).astype(np.float64)
    square = np.maximum(gram.diagonal(axis1=1, axis2=2), 1e-12)
    size = np.sqrt(square.mean(axis=0))
    # All ways at once, each of unit length: what one of them leaves is not blamed on another that looks alike.
    along, gram = along / size, gram / np.outer(size, size)
    found = np.maximum(((along * size**2 / square) ** 2).mean(axis=0), 1.0)
    eye = np.eye(len(size))
    for _ in range(_ROUNDS):
        spread = np.linalg.inv(gram + eye / found)
        middle = (spread @ along[:, :, None])[:, :, 0]
        found = np.maximum((middle**2 + spread.diagonal(axis1=1, axis2=2)).mean(axis=0), 1e-6)
    return run * found / size**2
