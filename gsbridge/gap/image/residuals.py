"""Residuals in units of the noise: later photos minus those expected from earlier photos under some effects."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import cv2
import numpy as np
from scipy.optimize import nnls

from gsbridge.effects.images.camera_pipeline import Shooting
from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.image.expect import Expectation
from gsbridge.gap.image.model import shooting
from gsbridge.gap.image.noise_model import LEAST, Flats, SharedNoise, slopes_of
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.visibility import off_steps
from gsbridge.geometry import Array

HEIGHT = 48
"""Approximate number of rows at which photos are compared. Averaging over blocks hides the blur of subpixel interpolation."""

COARSE = 12
"""Approximate number of rows at which a search for large displacements starts."""

_BORDER = 0.05
"""Border that is not compared, as a share of the width: a displaced camera sees things there that the earlier photo lacks."""

PLACE = 0.1
"""Standard deviation of the image position of things, due to errors of depth and interpolation, in compared pixels."""

_PARTS = 12
"""Number of brightness classes in which noise is learnt."""

_OUTLIER = 4.0
"""Standard deviations beyond which a difference between repeated photos is an outlier, not noise."""

_NEAR = 5
"""Half width of the window over which the noise variance is taken to be constant, in compared pixels."""

_KEPT = 64
"""Number of residuals in the cache."""

_UNSURE = 0.015
"""Relative standard deviation of the noise variance of each colour as learnt from photos."""

_CLEAR = 5.0
"""Standard deviations by which the noise of later photos must exceed that of earlier ones to count as larger."""


@dataclass(frozen=True)
class PhotoNoise:
    """Noise variance of one photo, for the block means that are compared.

    Args:
        dark: Variance at black.
        light: Increase of the variance from black to white.
    """

    dark: float
    light: float

    def at(self, levels: Array) -> Array:
        """Return the variance at encoded levels, 0..1. [...] -> [...]."""
        return self.dark + self.light * np.clip(levels, 0.0, 1.0)

    def levels(self) -> dict[str, float]:
        """Return the standard deviations at black and at white, for the findings."""
        return {"dark": float(np.sqrt(self.dark)), "white": float(np.sqrt(self.dark + self.light))}


def learn_noise(pairs: Sequence[Pairs]) -> PhotoNoise:
    """Learn the noise from repeated photos of the same views with nothing changed."""
    levels, squares = [], []
    for views in pairs:
        size = shrinking(views)
        one, other = (shrunk(photos, size) for photos in (views.before, views.again))
        kept = compared(views) > 0
        levels.append(0.5 * (one + other)[kept])
        squares.append((other - one)[kept] ** 2 / (1.0 + 1.0 / views.repeats))
    level, square = np.concatenate(levels).ravel().astype(np.float64), np.concatenate(squares).ravel().astype(np.float64)
    order = np.argsort(level)
    rows, means = [], []
    for part in np.array_split(order, _PARTS):
        # A few pixels may show things that moved between the photos.
        limit = _OUTLIER**2 * np.median(square[part]) / 0.455
        rows.append([1.0, level[part].mean()])
        means.append(square[part][square[part] <= limit].mean() if limit > 0 else 0.0)
    size = shrinking(pairs[0])
    least = LEAST / size**2
    weight = 1.0 / np.maximum(means, least)
    dark, light = nnls(np.array(rows) * weight[:, None], np.array(means) * weight)[0]
    return PhotoNoise(max(float(dark), least), float(light))


def shrinking(pairs: Pairs, height: int = HEIGHT) -> int:
    """Return the edge of the blocks, px, over which photos are averaged to have about `height` rows."""
    return max(1, round(pairs.camera.height / height))


def shrunk(photos: Array, size: int) -> Array:
    """Average over blocks; rows and columns beyond the last whole block are dropped. [N, H, W, ...] -> [N, h, w, ...]."""
    count, height, width = photos.shape[:3]
    tall, wide = height // size, width // size
    parts = photos[:, : tall * size, : wide * size].reshape(count, tall, size, wide, size, *photos.shape[3:])
    return parts.mean(axis=(2, 4))


def compared(pairs: Pairs, height: int = HEIGHT) -> Array:
    """Mask the pixels to compare: with known depth, away from the border and from steps of depth. [N, h, w], 0 or 1."""
    size, border = shrinking(pairs, height), max(1, round(_BORDER * pairs.camera.width))
    kept = np.stack([off_steps(depth) for depth in pairs.depths])
    kept[:, :border] = kept[:, -border:] = False
    kept[:, :, :border] = kept[:, :, -border:] = False
    return (shrunk(kept.astype(np.float32), size) >= 1.0).astype(np.float32)


class ImageResiduals:
    """Residuals of the views of a role, in units of the noise.

    Args:
        pairs: The views.
        noise: Noise of one photo.
        compare_noise: Whether the variances of the photos' noise are compared, too; they must not be if `pairs.after` holds
            means of several photos, which have less noise.
        height: Approximate number of rows to compare. With few rows, as for large displacements, `noise` overstates the noise.
        expectation: `Expectation` of the same photos to reuse, since their denoising is the slowest step; None makes one.

    Attributes:
        model_tolerance: Share of a gap's sum of squares that the models of effects may miss; a further effect must explain more
            than this.
        shape: Numbers of photos, rows and columns as compared.
        mask: 1 where photos are compared, else 0. [N, h, w].
    """

    model_tolerance: ClassVar[float] = 1e-3

    def __init__(
        self,
        pairs: Pairs,
        noise: PhotoNoise,
        *,
        compare_noise: bool = True,
        height: int = HEIGHT,
        expectation: Expectation | None = None,
    ) -> None:
        self.pairs, self.noise, self._compares_noise = pairs, noise, compare_noise
        self.expectation = expectation or Expectation(pairs)
        self._known: OrderedDict[tuple[object, ...], Array] = OrderedDict()
        self.size = shrinking(pairs, height)
        self.after = shrunk(pairs.after, self.size)
        self.mask = compared(pairs, height)
        self.shape = self.mask.shape
        self._weights = (self.mask[..., None] / np.sqrt(self._variance())).astype(np.float32)

    def _variance(self) -> Array:
        """Return the variance of the difference of a later and an earlier photo. [N, h, w, 1 or 3]."""
        before, again = (shrunk(photos, self.size) for photos in (self.pairs.before, self.pairs.again))
        # Noisier photos get less weight, whatever the cause; whether they are noisier is tested by the noise part alone.
        local = self._local(again - before, self.noise.at(before))
        variance = local * (self._rougher() * self.noise.at(self.after) + self.noise.at(before))
        return variance + PLACE**2 * slopes_of(before.astype(np.float32))[..., None]

    def residual(self, effects: Sequence[Applied] = ()) -> Array:
        """Return later photos minus expected ones, a row per image row, then a row of noise per photo. [N * h + N, 3 * w]."""
        # Cached: a fit asks for the same effects again for its derivatives and at its end.
        key = tuple((effect.name, *sorted(effect.parameters.items())) for effect in effects)
        if key not in self._known:
            self._known[key] = self._residual(effects)
            self._known[key].flags.writeable = False
            if len(self._known) > _KEPT:
                self._known.popitem(last=False)
        return self._known[key]

    def apart(self, how: Shooting) -> Array:
        """Return later photos minus expected ones, in units of the standard deviation of each pixel. [N, h, w, 3]."""
        apart = (self.after - shrunk(self.expectation.photos(how), self.size)) * self._weights
        shown = shrunk(self.expectation.shown(how).astype(np.float32), self.size) >= 1.0
        if not shown.all():
            # Pixels that come into sight say nothing. The others are scaled up to replace them; otherwise a fit could lower the
            # residual by turning the camera away.
            kept = np.maximum((self.mask * shown).sum(), 1.0)
            apart *= shown[..., None] * np.float32(np.sqrt(self.mask.sum() / kept))
        return apart

    def _residual(self, effects: Sequence[Applied]) -> Array:
        how = shooting(effects, self.pairs.edge)
        apart = self.apart(how)
        count, height, width = self.shape
        rough = self._rough(how)
        grain = np.zeros((count, 3 * width), np.float32)
        grain[:, : rough[0].size] = rough.reshape(count, -1)
        return np.concatenate([apart.reshape(count * height, 3 * width), grain])

    def pictures(self, table: Array) -> Array:
        """Return the image part of a residual. [N * h + N, 3 * w] -> [N, h, w, 3]."""
        count, height, width = self.shape
        return table[: count * height].reshape(count, height, width, 3)

    def noise_part(self, table: Array) -> Array:
        """Return the part of a residual that compares the photos' noise. [N * h + N, 3 * w] -> [N, 3 * w]."""
        return table[self.shape[0] * self.shape[1] :]

    def size_of(self, table: Array) -> float:
        """Return the root mean square of a residual, in units of the noise. [N * h + N, 3 * w]."""
        return float(np.sqrt((table.astype(np.float64) ** 2).sum() / self.numbers))

    def tells(self, candidate: Candidate) -> bool:
        """Whether photos can identify an effect at all: without time stamps, flicker looks like any other change of light."""
        return self.pairs.times is not None or not candidate.effect.timed

    @property
    def numbers(self) -> int:
        """Number of measured values in a residual."""
        return 3 * int(self.mask.sum()) + 3 * int(np.isfinite(self._spread).sum())

    @cached_property
    def usual(self) -> Array:
        """Difference of repeated photos, in units of its root mean square in each colour. [N, h, w, 3]."""
        apart = (shrunk(self.pairs.again, self.size) - shrunk(self.pairs.before, self.size)) * self._weights
        return apart / np.sqrt(np.maximum((apart**2).sum(axis=(0, 1, 2)) / max(float(self.mask.sum()), 1.0), 1e-12))

    def replicate(self, rng: np.random.Generator, patch: int = 1) -> Array:
        """Draw a residual in which nothing has changed. [N * h + N, 3 * w].

        It is the difference of repeated photos with random signs, which keeps outliers of the noise but removes its spatial
        correlation beyond a patch.

        Args:
            rng: Random numbers.
            patch: Edge of the patches that share a sign, in compared pixels.
        """
        usual, measured = self.usual, self.noise_part(self.residual()) != 0
        count, height, width = self.shape
        size = np.sqrt(np.maximum(1.0 + _UNSURE * rng.standard_normal(usual.shape[-1]), 0.0)).astype(np.float32)
        # One sign for all colours of a pixel, since their differences are often correlated.
        down, across = rng.integers(patch, size=2) if patch > 1 else (0, 0)
        signs = rng.choice(
            np.array((-1.0, 1.0), np.float32), (count, -(-(height + down) // patch), -(-(width + across) // patch))
        )
        signs = signs.repeat(patch, axis=1).repeat(patch, axis=2)[:, down : down + height, across : across + width]
        white = usual * signs[..., None] * size
        rough = rng.standard_normal(measured.shape)
        classes = self._spread.shape[1]
        if self._compares_noise:
            mixed = rough[:, : 3 * classes].reshape(count, classes, 3) @ np.linalg.cholesky(self._shared.colours).T
            rough[:, : 3 * classes] = mixed.reshape(count, -1)
        return np.concatenate([white.reshape(-1, measured.shape[1]), rough.astype(np.float32) * measured])

    def usual_table(self) -> Array:
        """Return the difference of repeated photos as a residual without a noise part. [N * h + N, 3 * w]."""
        count, height, width = self.shape
        pictures = self.usual.reshape(count * height, 3 * width)
        return np.concatenate([pictures, np.zeros((count, 3 * width), np.float32)]).astype(np.float32)

    def leave_out(self, pixels: Array) -> None:
        """Exclude some pixels from the comparison. [N, h, w] bool."""
        self.mask = self.mask * ~pixels
        self._weights = self._weights * ~pixels[..., None]
        self._known.clear()

    def coarse(self) -> ImageResiduals:
        """Return these views in so few rows that large displacements can be found."""
        return ImageResiduals(self.pairs, self.noise, compare_noise=False, height=COARSE, expectation=self.expectation)

    def quiet(self) -> ImageResiduals:
        """Return the residuals of these views with nothing changed; see `Pairs.quiet`."""
        grainy = self.pairs.repeats == 1
        return ImageResiduals(self.pairs.quiet(), self.noise, compare_noise=grainy, expectation=self.expectation)

    @cached_property
    def _flats(self) -> Flats:
        covered = cv2.resize(
            self.mask.transpose(1, 2, 0),
            (self.shape[2] * self.size, self.shape[1] * self.size),
            interpolation=cv2.INTER_NEAREST,
        )
        seen = covered.reshape(*covered.shape[:2], -1).transpose(2, 0, 1) > 0
        height, width = self.pairs.camera.height, self.pairs.camera.width
        whole = np.zeros((len(self.pairs), height, width), bool)
        whole[:, : seen.shape[1], : seen.shape[2]] = seen
        # By photos of their own: where `before` looks flat, its noise is small by chance, and that of any later photo larger.
        # Where the repeated photos stand for the later ones, both of them choose.
        looks = self.pairs.again.astype(np.float32)
        if self.pairs.after is self.pairs.again:
            looks = 0.5 * (looks + self.pairs.before.astype(np.float32))
        return Flats.of(looks, slopes_of(looks), whole)

    @cached_property
    def _spread(self) -> Array:
        """Standard deviation of the log ratio of two measured noise variances; infinite where not measured. [N, L]."""
        spread = np.sqrt(2.0) * self._flats.deviations()
        return spread * np.sqrt(self._shared.pixels) if self._compares_noise else np.full_like(spread, np.inf)

    @cached_property
    def _shared(self) -> SharedNoise:
        """What neighbouring pixels and the colours of a pixel share of the noise, as repeated photos show."""
        return self._flats.shared(self.pairs.again - self.pairs.before)

    @cached_property
    def _grain(self) -> Array:
        return self._flats.variances(self.pairs.after.astype(np.float32))

    @cached_property
    def _still(self) -> Array:
        """Noise variance that is expected without any change of light or sensor. [N, L, 3]."""
        return self._flats.variances(self.expectation.flat(shooting()))

    def _local(self, apart: Array, variance: Array) -> Array:
        """Return the local noise variance, relative to that learnt for the brightness, 1 at the least. [N, h, w, 1].

        Repeated photos differ by more than the learnt noise in places such as flickering shade or shiny things.

        Args:
            apart: Difference of repeated photos. [N, h, w, 3].
            variance: Noise variance learnt for the brightness. [N, h, w, 3].
        """
        square = (apart**2 / (variance * (1.0 + 1.0 / self.pairs.repeats))).mean(axis=-1) * self.mask
        size = (2 * _NEAR + 1,) * 2
        near = np.stack([cv2.blur(part.astype(np.float64), size) for part in square])
        filled = np.stack([cv2.blur(part.astype(np.float64), size) for part in self.mask])
        return np.maximum(near / np.maximum(filled, 1e-6), 1.0).astype(np.float32)[..., None]

    def _rougher(self) -> float:
        """Return the ratio of the later photos' noise variance to the earlier ones', or 1 if it is not clearly larger."""
        rough = self._rough(shooting())
        measured = np.isfinite(self._spread)
        if not measured.any():
            return 1.0
        weight = 1.0 / self._spread[measured] ** 2
        mean = float((rough[measured] * self._spread[measured][:, None]).mean(axis=1) @ weight / weight.sum())
        return float(np.exp(mean)) if mean > _CLEAR / np.sqrt(3.0 * weight.sum()) else 1.0

    def _rough(self, how: Shooting) -> Array:
        """Return the log ratio of measured to expected noise variance, in standard deviations; 0 if not measured. [N, L, 3]."""
        if not self._compares_noise:
            return np.zeros((*self._spread.shape, 3))
        # Effects that only move the image leave the noise unchanged.
        still = not (how.light or how.sensor or how.softness)
        expected = self._still if still else self._flats.variances(self.expectation.flat(how))
        expected = expected + how.read_variance + how.shot_variance * np.clip(self._flats.levels, 0.0, 1.0)
        ratio = np.nan_to_num(np.log(self._grain) - np.log(expected))
        return ratio / self._spread[..., None]
