"""The Gaussian set of one model: where each splat is, its shape, opacity and colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.geometry import Array, Similarity, quat_from_rotation, quat_multiply

SH_C0 = 0.28209479177387814
"""Constant spherical harmonic, 1 / (2 sqrt(pi)): the 3DGS files store `(rgb - 0.5) / SH_C0`."""


@dataclass(frozen=True)
class Cloud:
    """Gaussians of view-independent colour, table frame.

    Args:
        means: Centres, m. [N, 3] float32.
        quats: Orientation of the axes, unit wxyz. [N, 4] float32.
        scales: Standard deviations along the axes, m. [N, 3] float32.
        opacities: 0..1. [N] float32.
        colours: sRGB as in the photos, 0..1. [N, 3] float32.
    """

    means: Array
    quats: Array
    scales: Array
    opacities: Array
    colours: Array

    def __post_init__(self) -> None:
        shapes = {"means": (3,), "quats": (4,), "scales": (3,), "opacities": (), "colours": (3,)}
        count = len(self.means)
        for name, tail in shapes.items():
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float32)
            if value.shape != (count, *tail):
                raise ValueError(f"{name} of {count} splats must have the shape {(count, *tail)}, not {value.shape}")
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.means)

    def subset(self, keep: Array) -> Cloud:
        """The splats that an index or a truth value selects. [N] or [M]."""
        return Cloud(self.means[keep], self.quats[keep], self.scales[keep], self.opacities[keep], self.colours[keep])

    def transformed(self, target_from_source: Similarity) -> Cloud:
        """These splats in another frame, or moved: means, orientations and sizes follow.

        Source: Wu et al., RL-GSBridge, equation 3, extended by the scale.
        """
        turn = quat_from_rotation(target_from_source.rotation)
        quats = quat_multiply(np.broadcast_to(turn, self.quats.shape), self.quats)
        return Cloud(
            target_from_source.apply(self.means.astype(np.float64)),
            quats,
            self.scales * target_from_source.scale,
            self.opacities,
            self.colours,
        )

    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner of the centres, m. [3], [3]."""
        return self.means.min(0), self.means.max(0)


def concatenate(clouds: Sequence[Cloud]) -> Cloud:
    """All splats of several clouds in one, in the given order.

    Raises:
        ValueError: No cloud was given.
    """
    if not clouds:
        raise ValueError("there is no cloud to join")
    names = ("means", "quats", "scales", "opacities", "colours")
    return Cloud(*(np.concatenate([getattr(cloud, name) for cloud in clouds]) for name in names))
