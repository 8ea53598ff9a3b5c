"""The set of Gaussians of one model: position, shape, opacity and colour of each splat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gsbridge.geometry import Array, Similarity, quat_from_rotation, quat_multiply
from gsbridge.splats.harmonics import degree_of, turned

SH_C0 = 0.28209479177387814
"""Constant spherical harmonic, 1 / (2 sqrt(pi)): 3DGS files store `(rgb - 0.5) / SH_C0`."""

FIELDS = ("means", "quats", "scales", "opacities", "colours", "harmonics")
"""Arrays of a `Cloud`, in the order of its arguments."""


@dataclass(frozen=True)
class Cloud:
    """Gaussians, table frame.

    Args:
        means: Centres, m. [N, 3] float32.
        quats: Orientation of the axes, unit wxyz. [N, 4] float32.
        scales: Standard deviations along the axes, m. [N, 3] float32.
        opacities: Opacities, 0..1. [N] float32.
        colours: sRGB as in the photos, 0..1; with harmonics, the part that does not depend on direction. [N, 3] float32.
        harmonics: Coefficients of the colours' dependence on viewing direction, in the cloud's frame
            (`gsbridge.splats.harmonics`); K is 0, 3, 8 or 15. Without them, colours do not depend on direction. [N, K, 3]
            float32.
    """

    means: Array
    quats: Array
    scales: Array
    opacities: Array
    colours: Array
    harmonics: Array = field(default_factory=lambda: np.zeros((0, 0, 3), np.float32))

    def __post_init__(self) -> None:
        shapes = {"means": (3,), "quats": (4,), "scales": (3,), "opacities": (), "colours": (3,)}
        count = len(self.means)
        if np.size(self.harmonics) == 0:
            object.__setattr__(self, "harmonics", np.zeros((count, np.shape(self.harmonics)[1], 3), np.float32))
        shapes["harmonics"] = (np.shape(self.harmonics)[1], 3)
        degree_of(shapes["harmonics"][0])
        for name, tail in shapes.items():
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float32)
            if value.shape != (count, *tail):
                raise ValueError(f"{name} of {count} splats must have the shape {(count, *tail)}, not {value.shape}")
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics; 0 if colours do not depend on direction."""
        return degree_of(self.harmonics.shape[1])

    def subset(self, keep: Array) -> Cloud:
        """Return the splats that a mask (bool [N]) or indices ([M]) select."""
        return Cloud(*(getattr(self, name)[keep] for name in FIELDS))

    def transformed(self, target_from_source: Similarity) -> Cloud:
        """Return the splats in another frame, or moved: means, orientations, sizes and harmonics are transformed.

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
            turned(self.harmonics, target_from_source.rotation),
        )

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and highest corner of the centres' bounding box, m. [3], [3]."""
        return self.means.min(0), self.means.max(0)


def concatenate(clouds: Sequence[Cloud]) -> Cloud:
    """Join several clouds in the given order; all get as many harmonics as the cloud that has most, filled up with zeros.

    Raises:
        ValueError: No cloud was given.
    """
    if not clouds:
        raise ValueError("there is no cloud to join")
    terms = max(cloud.harmonics.shape[1] for cloud in clouds)
    parts = {name: [getattr(cloud, name) for cloud in clouds] for name in FIELDS}
    parts["harmonics"] = [np.pad(rows, ((0, 0), (0, terms - rows.shape[1]), (0, 0))) for rows in parts["harmonics"]]
    return Cloud(*(np.concatenate(parts[name]) for name in FIELDS))
