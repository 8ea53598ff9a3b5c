"""What photos and pictures differ by although nothing is missing, learnt from effect-free photos of the same scene.

Splats are softer or harder than a lens, lack detail, and have colours that are a little off. The differences that remain are
larger at edges, smooth over several pixels, and alike in the three colours. Residuals are divided by their size at such
places, turned to colours that vary on their own, and divided by the root of their spectrum: what is left is white where
nothing is missing. Grain is looked at apart, in flat places, where neither edges nor a displaced picture disturb it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.fft import dctn, idctn
from scipy.optimize import least_squares, nnls

from gsbridge.errors import InputError
from gsbridge.gap.image.model import ImageModel
from gsbridge.gap.image.shots import REFERENCE, Shots
from gsbridge.geometry import Array
from gsbridge.scene.photograph import BLURS

FEWEST = 8
"""Reference photos from which a floor can be learnt."""

LEVELS = 5
"""Classes of brightness in which grain is measured."""

_BINS = 9
"""Frequencies at which the spectrum is kept."""

_LEAST = (0.3 / 255.0) ** 2
"""Variance that 8 bits leave at least."""

_CLIP = 4.0
"""Deviations beyond which a residual counts as that many when sizes are learnt: reflections, things that moved."""

_GRAIN = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]], np.float32) / 6.0
"""Takes slopes and edges away and leaves the variance of white noise as it is (Immerkaer, CVIU 64(2), 1996)."""

_OVERLAP = float((cv2.filter2D(np.pad(_GRAIN, 4), -1, _GRAIN, borderType=cv2.BORDER_CONSTANT) ** 2).sum())
"""By how much fewer independent numbers filtered noise holds than pixels: the sum of its squared correlations."""


@dataclass(frozen=True)
class Floor:
    """What effect-free residuals look like.

    Args:
        softness: By how much pictures are sharpened to look like photos; see `gsbridge.scene.photograph.softened`.
        spread: Variance of encoded residuals in flat places, and its growth with the squared slope of the picture.
        basis: Colours that vary on their own, in columns. [3, 3].
        frequencies: Of the spectrum, cycles per pixel. [K].
        spectrum: Of normalised residuals, for each of these colours. [3, K].
        grain: Variance of grain in the dark, and its growth up to white.
        scatter: By how much the logarithm of measured grain varies beyond counting, as a variance.
        scale: Variance of all of the above is multiplied by this; see `gsbridge.gap.image.null`.
        common: By how much pictures are off as a whole, in ways that effects are too: variance of the amplitude of every
            direction of `gsbridge.gap.image.common`; empty before it is known.
        photos: From how many photos it was learnt.
    """

    softness: tuple[float, ...]
    spread: tuple[float, float]
    basis: Array
    frequencies: Array
    spectrum: Array
    grain: tuple[float, float]
    scatter: float
    scale: float
    photos: int
    common: tuple[float, ...] = ()

    def sizes(self, slopes: Array) -> Array:
        """Deviations of residuals where pictures have some squared slopes. [...]."""
        return np.sqrt(self.spread[0] + self.spread[1] * slopes)

    def whiten(self, residual: Array, sizes: Array, extra: float = 0.0) -> Array:
        """Encoded differences in units of the floor, colours turned. [N, H, W, 3] -> [N, H, W, 3] float32.

        Args:
            residual: Encoded differences.
            sizes: As from `sizes`. [N, H, W].
            extra: Variance of further white noise, in units of the squared sizes.
        """
        height, width = residual.shape[1:3]
        turned = (residual / sizes[..., None]) @ self.basis.astype(np.float32)
        waves = dctn(turned, axes=(1, 2), norm="ortho")
        return idctn(waves * self._filter(height, width, extra), axes=(1, 2), norm="ortho").astype(np.float32)

    def _filter(self, height: int, width: int, extra: float) -> Array:
        """Inverse root of the spectrum. [H, W, 3]."""
        far = np.log(radii(height, width))
        power = np.stack([np.exp(np.interp(far, np.log(self.frequencies), np.log(row))) for row in self.spectrum], axis=-1)
        return (1.0 / np.sqrt(self.scale * (power + extra))).astype(np.float32)


def radii(height: int, width: int) -> Array:
    """Frequencies of a cosine transform, cycles per pixel; the constant counts as a half of the lowest. [H, W]."""
    far = np.hypot(np.arange(height)[:, None] / (2.0 * height), np.arange(width) / (2.0 * width))
    return np.maximum(far, 0.25 / max(height, width))


def slopes_of(pictures: Array) -> Array:
    """Squared slope of the encoded picture, averaged over colours and neighbours. [N, H, W, 3] -> [N, H, W]."""
    out = []
    for picture in pictures:
        across = cv2.Scharr(picture, cv2.CV_32F, 1, 0, scale=1 / 32.0)
        down = cv2.Scharr(picture, cv2.CV_32F, 0, 1, scale=1 / 32.0)
        out.append(cv2.blur((across**2 + down**2).mean(axis=-1), (3, 3)))
    return np.stack(out)


@dataclass(frozen=True)
class Flats:
    """Flat places of pictures, by brightness.

    Args:
        masks: For every photo and class. [N, L, H, W] bool.
        levels: Mean brightness of each, one per colour. [N, L, 3].
        counts: Pixels. [N, L].
    """

    masks: Array
    levels: Array
    counts: Array

    @classmethod
    def of(cls, pictures: Array, slopes: Array, covered: Array) -> Flats:
        """The flatter half of all covered pixels, split at quantiles of brightness."""
        grey = pictures.mean(axis=-1)
        flat = (slopes <= np.median(slopes)) & covered
        flat[:, [0, -1], :] = flat[:, :, [0, -1]] = False
        edges = np.quantile(grey[flat], np.linspace(0, 1, LEVELS + 1)[1:-1]) if flat.any() else np.zeros(LEVELS - 1)
        kind = np.digitize(grey, edges)
        masks = np.stack([flat & (kind == k) for k in range(LEVELS)], axis=1)
        counts = masks.sum(axis=(2, 3))
        levels = np.einsum("nlhw,nhwc->nlc", masks.astype(np.float32), pictures) / np.maximum(counts, 1)[..., None]
        return cls(masks, levels.astype(np.float64), counts)

    def variances(self, residual: Array) -> Array:
        """Grain of encoded residuals in every class, robust against what is no grain. [N, H, W, 3] -> [N, L, 3]."""
        fine = np.stack([cv2.filter2D(image, -1, _GRAIN, borderType=cv2.BORDER_REPLICATE) for image in residual])
        out = np.full((*self.counts.shape, 3), np.nan)
        for n, k in np.argwhere(self.counts >= 20):
            # A third of the way between robust and efficient: squares beyond three rough deviations are left out.
            square = fine[n][self.masks[n, k]].astype(np.float64) ** 2
            rough = 2.198 * np.median(square, axis=0)
            inside = square <= 9.0 * rough
            out[n, k] = (square * inside).sum(axis=0) / np.maximum(inside.sum(axis=0), 1) / 0.9733
        return np.maximum(out, _LEAST * 0.1)

    def weights(self, scatter: float) -> Array:
        """Inverse deviations of the logarithm of a measured variance; zero where there are too few pixels. [N, L, 1]."""
        variance = 2.0 * _OVERLAP / np.maximum(self.counts, 1) + scatter
        return (np.where(self.counts >= 20, 1.0, 0.0) / np.sqrt(variance))[..., None]


def learn_floor(model: ImageModel, shots: Shots) -> Floor:
    """The floor of a model from effect-free photos.

    Args:
        model: With what is known to be there.
        shots: The photos.

    Raises:
        InputError: There are too few.
    """
    if len(shots) < FEWEST:
        raise InputError(
            shots.name or REFERENCE,
            f"there are {len(shots)} effect-free photos",
            f"Give {FEWEST} or more; see docs/gap_images.md",
        )
    plain = model.expected(shots, model.shooting())
    covered = model.photographer.covered(shots.track, shots.times)
    slopes = slopes_of(plain)
    spread = _spread(shots.photos - plain, slopes, covered)

    def misfit(amounts: Array) -> Array:
        pictures = model.expected(shots, model.shooting(softness=tuple(amounts)))
        return ((shots.photos - pictures) * (covered / np.sqrt(spread[0] + spread[1] * slopes))[..., None]).ravel()

    found = least_squares(misfit, np.zeros(len(BLURS)), bounds=(-2.0, 4.0), loss="soft_l1", max_nfev=8)
    softness = tuple(float(amount) for amount in found.x)
    pictures = model.expected(shots, model.shooting(softness=softness))
    residual, slopes = shots.photos - pictures, slopes_of(pictures)
    spread = _spread(residual, slopes, covered)
    sizes = np.sqrt(spread[0] + spread[1] * slopes)
    unit = np.clip(residual * (covered / sizes)[..., None], -_CLIP, _CLIP)
    _, basis = np.linalg.eigh(np.cov(unit.reshape(-1, 3).T.astype(np.float64)))
    waves = dctn(unit @ basis.astype(np.float32), axes=(1, 2), norm="ortho").astype(np.float64)
    frequencies, spectrum = _spectrum(waves)
    flats = Flats.of(pictures, slopes, covered > 0)
    grain, scatter = _grain(flats, residual)
    return Floor(softness, spread, basis, frequencies, spectrum, grain, scatter, 1.0, len(shots))


def _spread(residual: Array, slopes: Array, covered: Array) -> tuple[float, float]:
    """Variance in flat places and its growth with the squared slope, from means over classes of slope."""
    slopes, squares = slopes[covered > 0], (residual**2).mean(axis=-1)[covered > 0]
    order = np.argsort(slopes)
    squares, across = squares[order].astype(np.float64), slopes[order].astype(np.float64)
    parts = np.array_split(np.arange(len(order)), 24)
    rows = np.array([[1.0, across[part].mean()] for part in parts])
    means = np.array([np.minimum(squares[part], _CLIP**2 * np.median(squares[part]) + _LEAST).mean() for part in parts])
    weights = 1.0 / np.maximum(means, _LEAST)
    flat, steep = nnls(rows * weights[:, None], means * weights)[0]
    return max(float(flat), _LEAST), float(steep)


def _spectrum(waves: Array) -> tuple[Array, Array]:
    """Mean power in rings of frequency. [N, H, W, 3] -> [K], [3, K]."""
    far = radii(*waves.shape[1:3])
    edges = np.geomspace(far.min(), far.max() * 1.001, _BINS + 1)
    # The lowest rings hold few waves: each must hold four, or it joins the next.
    nodes, rows, members = [], [], np.zeros(far.shape, bool)
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        members = members | ((far >= low) & (far < high))
        if members.sum() >= 4:
            nodes.append(float(np.exp(np.log(far[members]).mean())))
            rows.append((waves[:, members] ** 2).mean(axis=(0, 1)))
            members = np.zeros(far.shape, bool)
    return np.array(nodes), np.maximum(np.array(rows).T, 1e-6)


def _grain(flats: Flats, residual: Array) -> tuple[tuple[float, float], float]:
    """Variance of grain as a line over brightness, and the scatter of its logarithm beyond counting."""
    found, weights = flats.variances(residual), np.broadcast_to(flats.weights(0.0), (*flats.counts.shape, 3))
    good = np.isfinite(found) & (weights > 0)
    values, share, weight = found[good], flats.levels[good], weights[good]
    dark, light = float(np.median(values)), 0.0
    for _ in range(4):
        wide = weight / (dark + light * share)
        dark, light = (float(x) for x in nnls(np.stack([wide, share * wide], axis=1), values * wide)[0])
        dark = max(dark, _LEAST * 0.1)
    off = np.log(values / (dark + light * share))
    return (dark, light), max(float((off**2).mean() - (1.0 / weight**2).mean()), 0.0)
