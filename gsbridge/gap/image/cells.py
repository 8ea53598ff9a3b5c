"""Mean residuals by place: by cell of the world, or by cell of the image where no earlier view shows that part of the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.effects.images.camera_pipeline import CameraFrame
from gsbridge.gap.image.residuals import ImageResiduals, shrunk
from gsbridge.geometry import Array

_CELL = 0.012
"""Edge of the cells of the world, m."""

_IMAGE_CELLS = 8
"""Number of cells along the height of the image."""

_PRIOR = 2.0
"""Weight of the prior of each cell, in views: a mean of zero, and the mean variance of all cells."""


@dataclass(frozen=True)
class Cells:
    """Means and variances of residuals by cell.

    Args:
        keys: Numbers of the cells, in ascending order. [C].
        means: Mean residual of each cell, shrunk towards zero. [C, 3].
        variances: Variance of a pixel about that mean in a new view, which is not part of the average. [C].
    """

    keys: Array
    means: Array
    variances: Array

    @classmethod
    def learn(cls, keys: Sequence[Array], values: Sequence[Array]) -> Cells:
        """Learn means and variances by averaging over views.

        Args:
            keys: Cell of each compared pixel of every view. [P] each.
            values: Residuals of these pixels. [P, 3] each.
        """
        whole, of_view = np.unique(np.concatenate([np.unique(view) for view in keys]), return_counts=True)
        sums, squares, counts = np.zeros((len(whole), 3)), np.zeros(len(whole)), np.zeros(len(whole))
        for view, value in zip(keys, values, strict=True):
            place = np.searchsorted(whole, view)
            pixels = np.bincount(place, minlength=len(whole))
            mean = np.stack([np.bincount(place, value[:, k], len(whole)) for k in range(3)], axis=1)
            sums += mean / np.maximum(pixels, 1)[:, None]
            squares += np.bincount(place, (value.astype(np.float64) ** 2).mean(axis=1), len(whole))
            counts += pixels
        means = sums / (of_view + _PRIOR)[:, None]
        # Variance about the shrunk mean; for a new view, the variance of that mean is added below.
        raw = np.maximum(squares / counts - (means * (2.0 * sums / of_view[:, None] - means)).mean(axis=1), 0.0)
        usual = float((raw * counts).sum() / counts.sum())
        spread = (of_view * raw * (1.0 + 1.0 / of_view) + _PRIOR * usual) / (of_view + _PRIOR)
        return cls(whole, means, spread)

    def at(self, keys: Array) -> tuple[Array, Array, Array]:
        """Return mean and variance of the cell of each pixel, and whether that cell was seen. [P, 3], [P], [P] bool."""
        place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        known = self.keys[place] == keys
        return np.where(known[:, None], self.means[place], 0.0), np.where(known, self.variances[place], 0.0), known


@dataclass(frozen=True)
class Lack:
    """What rendered images lack, by place: by cell of the world where a view has shown it, by cell of the image elsewhere.

    Args:
        world: Cells of the world.
        image: Cells of the image.
    """

    world: Cells
    image: Cells

    @classmethod
    def learn(cls, view: ImageResiduals, apart: Array, chosen: Sequence[int]) -> Lack:
        """Learn from the residuals of some views.

        Args:
            view: Rendered images and photos.
            apart: Photos minus rendered images, encoded, at the size at which they are compared. [N, h, w, 3].
            chosen: Numbers of the views to learn from.
        """
        inside = [view.mask[n] > 0 for n in chosen]
        values = [apart[n][kept] for n, kept in zip(chosen, inside, strict=True)]
        world, image = world_cells(view), image_cells(view)
        return cls(
            Cells.learn([world[n][kept] for n, kept in zip(chosen, inside, strict=True)], values),
            Cells.learn([image[n][kept] for n, kept in zip(chosen, inside, strict=True)], values),
        )

    def at(self, view: ImageResiduals) -> tuple[Array, Array]:
        """Return mean and variance of the residual expected in each pixel of some views. [N, h, w, 3], [N, h, w]."""
        mean, variance, known = self.world.at(world_cells(view).ravel())
        elsewhere, wide, _ = self.image.at(image_cells(view).ravel())
        mean, variance = np.where(known[:, None], mean, elsewhere), np.where(known, variance, wide)
        return mean.reshape(*view.shape, 3).astype(np.float32), variance.reshape(view.shape).astype(np.float32)


def world_cells(view: ImageResiduals) -> Array:
    """Return the number of the world cell that each pixel shows. [N, h, w] int64."""
    pairs, out = view.pairs, []
    for depth, pose in zip(view.expectation.depths, pairs.poses, strict=True):
        points = CameraFrame(pairs.camera, 0.0, depth, pose).points
        cells = np.floor(shrunk(points[None], view.size)[0] / _CELL).astype(np.int64) + (1 << 20)
        out.append((cells[..., 0] << 42) | (cells[..., 1] << 21) | cells[..., 2])
    return np.stack(out)


def image_cells(view: ImageResiduals) -> Array:
    """Return the number of the image cell that contains each pixel. [N, h, w] int64."""
    _, height, width = view.shape
    edge = max(1, height // _IMAGE_CELLS)
    cells = (np.arange(height) // edge)[:, None] * 4096 + np.arange(width) // edge
    return np.broadcast_to(cells, view.shape)
