"""Model error of rendered images compared with photos of the same states, learnt from photos taken while all was well.

Splats are softer than a lens, have floaters, and were filmed in another light by another camera. These errors exist before
anything changes, and equally on the day that is diagnosed: they are the model error. It is learnt in three steps from photos of
the registration's day. First, effects of the camera are fitted (`calibrate`). Second, the residuals are averaged by place
(`gsbridge.gap.image.cells`), and these means are added to rendered images. Third, the residuals that remain on held-out views
give the model error: a variance by place, and variances by scale, colour and common part (`gsbridge.gap.image.layers`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gsbridge.effects.images.camera_pipeline import Shooting
from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.image.cells import Lack
from gsbridge.gap.image.expect import Expectation
from gsbridge.gap.image.fit import fit
from gsbridge.gap.image.layers import LayerSpread
from gsbridge.gap.image.model import ImageCandidate, shooting
from gsbridge.gap.image.noise_model import slopes_of
from gsbridge.gap.image.pairs import FEWEST as FEWEST_VIEWS
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.residuals import COARSE, HEIGHT, PLACE, ImageResiduals, PhotoNoise, shrinking, shrunk
from gsbridge.geometry import Array

FEWEST, ENOUGH = 9, 18
"""Numbers of photos of the registration's day: the least that is accepted, and the least that gives no warning."""

CALIBRATED = (
    "exposure",
    "white_balance",
    "response",
    "black_level",
    "saturation",
    "defocus",
    "extrinsics",
    "focal",
    "distortion",
)
"""Effects that the calibration fits jointly to photos of the registration's day; none of them is a finding."""

_FOLDS = 3
"""Number of folds of the cross-validation over views, where there are enough views for each to hold `FEWEST_VIEWS`."""

_ROUNDS = 8
"""Largest number of steps of the calibration, whose error need only be small compared with what remains afterwards."""

_FITTED = 12
"""Approximate number of views to which the calibration is fitted."""

_ROUGH = 0.03
"""Standard deviation of an encoded pixel that is assumed before the model error is learnt."""

_CLIPPED = 3.0
"""Robust standard deviations beyond which the calibration ignores a pixel, such as one of things that were never filmed."""

_LEAST = (0.5 / 255.0) ** 2
"""Smallest variance of a pixel, due to the rounding of photos to 8 bits."""


@dataclass(frozen=True)
class SplatError:
    """Systematic error of rendered images, and the variance of what remains after its correction.

    Args:
        calibration: Effects of the camera on the registration's day.
        lack: Residuals by place that remain after the calibration.
        layers: Variances of what remains after both corrections, by the number of rows at which images are compared.
        left: Root mean squares of photos minus rendered images, in encoded values: as rendered, after calibration, and after
            correction learnt from other views.
    """

    calibration: tuple[Applied, ...]
    lack: Lack
    layers: Mapping[int, LayerSpread]
    left: tuple[float, float, float]

    def corrected(self, pairs: Pairs) -> Pairs:
        """Return reduced rendered images as the camera would have shown them while all was well."""
        drawn = calibrated(pairs, self.calibration)
        view = plain_view(drawn)
        before = np.clip(drawn.before + self.lack.at(view)[0], 0.0, 1.0)
        return replace(drawn, before=before, again=before)


class SplatResiduals(ImageResiduals):
    """Photos minus corrected rendered images, in units of the model error.

    Args:
        pairs: Corrected images from `SplatError.corrected` (`before`), and photos (`after`).
        error: Model error of these images.
        height: Approximate number of rows to compare.
        expectation: `Expectation` of the same images to reuse; None makes one.
    """

    model_tolerance = 1e-2

    def __init__(
        self, pairs: Pairs, error: SplatError, *, height: int = HEIGHT, expectation: Expectation | None = None
    ) -> None:
        self.error, self._spread_of = error, error.layers.get(height)
        super().__init__(pairs, PhotoNoise(_LEAST, 0.0), compare_noise=False, height=height, expectation=expectation)

    def _variance(self) -> Array:
        before = shrunk(self.pairs.before, self.size).astype(np.float32)
        return (self.error.lack.at(self)[1] + _LEAST + PLACE**2 * slopes_of(before))[..., None]

    def apart(self, how: Shooting) -> Array:
        """Return photos minus expected ones, every part in units of its standard deviation. [N, h, w, 3]."""
        plain = super().apart(how)
        return plain if self._spread_of is None else self._spread_of.whitened(plain)

    def replicate(self, rng: np.random.Generator, patch: int = 1) -> Array:
        """Draw a residual in which nothing has changed, from held-out residuals of the registration. [N * h + N, 3 * w].

        Args:
            rng: Random numbers.
            patch: Of no use here, since detail of each size has a spread of its own.
        """
        count, height, width = self.shape
        assert self._spread_of is not None
        white = self._spread_of.replicate(self.mask[..., None], rng)
        return np.concatenate([white.reshape(count * height, 3 * width), np.zeros((count, 3 * width), np.float32)])

    def tells(self, candidate: Candidate) -> bool:
        """Whether photos can identify an effect at all: effects on noise cannot be, since rendered images have none."""
        return super().tells(candidate) and not candidate.effect.noise_only

    def coarse(self) -> ImageResiduals:
        """Return these views in so few rows that large displacements can be found."""
        return SplatResiduals(self.pairs, self.error, height=COARSE, expectation=self.expectation)


def plain_view(pairs: Pairs) -> ImageResiduals:
    """Return residuals of rendered images and photos with the same standard deviation for all pixels."""
    return ImageResiduals(pairs, PhotoNoise(0.5 * _ROUGH**2, 0.0), compare_noise=False)


def calibrated(pairs: Pairs, effects: Sequence[Applied]) -> Pairs:
    """Apply effects of the camera to rendered images and to their poses."""
    how = shooting(effects, pairs.edge)
    before = Expectation(pairs).photos(how)
    return replace(pairs, before=before, again=before, poses=how.mount @ pairs.poses)


def calibrate(pairs: Pairs) -> tuple[Applied, ...]:
    """Fit the effects in `CALIBRATED` to photos jointly, without outlying pixels such as those of things never filmed."""
    who = [ImageCandidate(name) for name in CALIBRATED]
    starts = [{p.name: 0.0 if p.amplitude else p.typical for p in one.effect.parameters} for one in who]
    pairs = subset(pairs, range(0, len(pairs), -(-len(pairs) // _FITTED)))
    view, effects = plain_view(pairs), tuple(one.applied(start) for one, start in zip(who, starts, strict=True))
    for _ in range(2):
        apart = np.abs(view.apart(shooting(effects, pairs.edge))).max(axis=-1)
        kept = view.mask > 0
        view.leave_out(kept & (apart > _CLIPPED * 1.4826 * float(np.median(apart[kept]))))
        effects = fit(view, who, [dict(effect.parameters) for effect in effects], _ROUNDS).effects
    return effects


def reduced(pairs: Pairs) -> Pairs:
    """Reduce images to about the size at which they are compared, since rendered images hold no finer detail."""
    size = shrinking(pairs)
    if size == 1:
        return pairs
    parts: dict[str, Any] = {
        name: shrunk(getattr(pairs, name), size).astype(np.float32) for name in ("before", "again", "after", "depths")
    }
    known = shrunk((pairs.depths > 0).astype(np.float32), size) >= 1.0
    parts["depths"] = np.where(known, parts["depths"], np.float32(0.0))
    height, width = known.shape[1:]
    camera = pairs.camera.cropped(0, 0, width * size, height * size).scaled(1.0 / size)
    return replace(pairs, camera=camera, edge=size * pairs.edge, **parts)


def learn_splat_error(registration: Pairs) -> SplatError:
    """Learn the model error of rendered images from photos of the registration's day.

    Args:
        registration: Rendered images (`before`) and photos (`after`) of that day.

    Raises:
        InputError: There are too few photos.
    """
    check_enough(registration)
    count = len(registration)
    registration = reduced(registration)
    raw = plain_view(registration)
    effects = calibrate(registration)
    view = plain_view(calibrated(registration, effects))
    apart = view.after - view.pairs.before
    lack, squares = Lack.learn(view, apart, range(count)), []
    folds: dict[int, list[Array]] = {HEIGHT: [], COARSE: []}
    number = min(_FOLDS, count // FEWEST_VIEWS)
    for fold in range(number):
        group = [n for n in range(count) if n % number == fold]
        others = [n for n in range(count) if n not in group]
        error = SplatError(effects, Lack.learn(view, apart, others), {}, (0.0,) * 3)
        chosen = error.corrected(subset(registration, group))
        for height, parts in folds.items():
            parts.append(SplatResiduals(chosen, error, height=height).apart(shooting()))
        rest = plain_view(chosen)
        squares.append((rest.after - chosen.before)[rest.mask > 0] ** 2)
    left = tuple(
        float(np.sqrt(np.mean(part)))
        for part in (
            (raw.after - registration.before)[raw.mask > 0] ** 2,
            apart[view.mask > 0] ** 2,
            np.concatenate(squares),
        )
    )
    layers = {height: LayerSpread.learn(parts) for height, parts in folds.items()}
    return SplatError(effects, lack, layers, left)  # type: ignore[arg-type]


def check_enough(registration: Pairs) -> None:
    """Check that there are enough photos of the registration's day.

    Raises:
        InputError: There are fewer than `FEWEST`.
    """
    if len(registration) < FEWEST:
        raise InputError(
            registration.name or "registration",
            f"there are {len(registration)} photos of the day on which all was well",
            f"Take {FEWEST} or more; see docs/gap_images.md",
        )


def subset(pairs: Pairs, chosen: Sequence[int]) -> Pairs:
    """Return some of the views, by their numbers."""
    rows = list(chosen)
    parts = {name: getattr(pairs, name)[rows] for name in ("before", "again", "after", "depths", "poses")}
    return replace(pairs, **parts)
