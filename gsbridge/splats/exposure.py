"""Exposure and white balance of single photos, for phones that change them while filming; the splats have one set of colours.

A photo shows a splat of linear light L as `gain * L + offset` in each channel. This acts on the splats' colours before
blending, so that the background behind them (the random colour in training, or another body) keeps its colour. The gains of all
training photos have a geometric mean of 1 and their offsets a mean of 0. The splats thus have the exposure of the mean photo,
and colours and exposures cannot drift against each other.

Training gives no exposure of a held-out photo. Each half of such a photo is scored with the exposure fitted to its other half.

Source: Martin-Brualla et al., "NeRF in the wild", 2021 (held-out photos by halves).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gsbridge.geometry import Array

PENALTY = {"gains": 0.01, "offsets": 1.0}
"""Weights of the mean squares of logarithmic gains and of offsets in the loss."""

RIDGE = {"gains": 1e-4, "offsets": 0.1}
"""Weights of `(gain - 1)^2` and `offset^2` relative to the mean squared error of light, in the fit to half of a held-out photo.
In a half of a single colour, gain and offset cannot be told apart; the weights then prefer to change the gain."""

FEWEST = 50
"""Smallest number of pixels to which an exposure is fitted; with fewer, the neutral exposure is used."""


@dataclass(frozen=True)
class Exposure:
    """Exposure of one photo.

    Args:
        gains: Factors on linear light. [3].
        offsets: Offsets added to linear light. [3].
    """

    gains: Array
    offsets: Array

    def apply(self, colours: Array) -> Array:
        """Return encoded sRGB colours as this photo shows them. [..., 3] float32."""
        return exposed(
            torch.from_numpy(colours), *(torch.as_tensor(x, dtype=torch.float32) for x in (self.gains, self.offsets))
        ).numpy()


NEUTRAL = Exposure(np.ones(3), np.zeros(3))


def exposed(colours: Tensor, gains: Tensor, offsets: Tensor) -> Tensor:
    """Apply gains and offsets of linear light to encoded colours and encode the result; values above 1 are not clamped.

    Args:
        colours: sRGB, encoded. [..., 3].
        gains: Factors on linear light. [3].
        offsets: Offsets added to linear light. [3].
    """
    # Clamp the bases of the powers: for a base that is not positive, the gradient of `where` would be NaN in either branch.
    bright = ((colours.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4
    light = torch.where(colours <= 0.04045, colours / 12.92, bright) * gains + offsets
    return torch.where(light <= 0.0031308, 12.92 * light, 1.055 * light.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)


class Exposures:
    """Exposures of the training photos, which are learned together with the splats.

    Args:
        names: Names of the photos. [P].
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self.parameters = {"exposure_gains": torch.zeros(len(names), 3), "exposure_offsets": torch.zeros(len(names), 3)}

    def __len__(self) -> int:
        return len(self.names)

    def _all(self) -> tuple[Tensor, Tensor]:
        """Return logarithmic gains and offsets of all photos, with their mean subtracted. [P, 3] each."""
        gains, offsets = self.parameters["exposure_gains"], self.parameters["exposure_offsets"]
        return gains - gains.mean(0), offsets - offsets.mean(0)

    def apply(self, colours: Tensor, photo: int) -> Tensor:
        """Return encoded colours as a photo shows them; differentiable. [N, 3]."""
        gains, offsets = self._all()
        return exposed(colours, torch.exp(gains[photo]), offsets[photo])

    def penalty(self) -> Tensor:
        """Return the term of the loss that keeps photos near the mean exposure where their pixels do not determine theirs."""
        gains, offsets = self._all()
        return PENALTY["gains"] * gains.square().mean() + PENALTY["offsets"] * offsets.square().mean()

    def found(self) -> dict[str, Exposure]:
        """Return the learned exposures by photo name."""
        with torch.no_grad():
            gains, offsets = (values.numpy().astype(np.float64) for values in self._all())
        return {name: Exposure(np.exp(gains[k]), offsets[k]) for k, name in enumerate(self.names)}


def fitted(drawn: Array, seen: Array) -> Exposure:
    """Fit the exposure that maps rendered light to the photo's light, by ridge regression.

    Args:
        drawn, seen: Linear light of the same pixels in the rendering and in the photo. [M, 3] each.
    """
    if len(drawn) < FEWEST:
        return NEUTRAL
    x, y = drawn.astype(np.float64), seen.astype(np.float64)
    gains, offsets = np.ones(3), np.zeros(3)
    for c in range(3):
        mean, square = x[:, c].mean(), (x[:, c] ** 2).mean()
        normal = np.array([[square + RIDGE["gains"], mean], [mean, 1.0 + RIDGE["offsets"]]])
        gains[c], offsets[c] = np.linalg.solve(normal, [(x[:, c] * y[:, c]).mean() + RIDGE["gains"], y[:, c].mean()])
    return Exposure(gains, offsets)


def to_record(exposures: Mapping[str, Exposure]) -> dict[str, Any]:
    """Return exposures in the form of a stage's record."""
    return {
        "held_out": "each half of a held-out photo is scored with the exposure that was fitted to its other half",
        "photos": {name: {"gains": e.gains.tolist(), "offsets": e.offsets.tolist()} for name, e in exposures.items()},
    }


def from_record(record: Mapping[str, Any] | None) -> dict[str, Exposure] | None:
    """Read exposures from a stage's record (the inverse of `to_record`); None stays None.

    Raises:
        KeyError, TypeError, ValueError: The record is damaged.
    """
    if record is None:
        return None
    return {
        name: Exposure(np.array(e["gains"], np.float64).reshape(3), np.array(e["offsets"], np.float64).reshape(3))
        for name, e in record["photos"].items()
    }
