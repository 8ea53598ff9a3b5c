"""What drawn pictures lack beside photos of the same states, learnt from photos that were taken while all was well.

Splats are softer than a lens, have floaters, and were filmed in another light by another camera. All this is there before
anything changes, and again on the day that is to be explained: it is the error of the model. It is learnt in three steps from
photos of the registration's day. What effects of a camera explain is fitted (`calibrate`). What is left is averaged by place
(`gsbridge.gap.image.cells`), and these means are added to what is drawn. What is left of views that took no part in this is the
error: a variance by place, and spreads of its details, colours and common part (`gsbridge.gap.image.layers`).
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
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.residuals import COARSE, HEIGHT, PLACE, ImageResiduals, PhotoNoise, shrinking, shrunk
from gsbridge.geometry import Array

FEWEST, ENOUGH = 9, 18
"""Photos of the day on which all was well: at the least, and from which on nothing is said about their number."""

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
"""Effects whose sizes on that day are fitted together; none of them is a finding."""

_FOLDS = 3
"""Groups of views, each of which is once left out."""

_ROUNDS = 8
"""Steps of the calibration at most; it needs to be good to a fraction of what is left."""

_FITTED = 12
"""Views that are fitted, about."""

_ROUGH = 0.03
"""Deviation of a pixel, encoded, before anything is known."""

_CLIPPED = 3.0
"""Deviations beyond which a pixel counts no more in the calibration: things that lie about and were never filmed."""

_LEAST = (0.5 / 255.0) ** 2
"""Variance of a pixel at the least: photos are rounded."""


@dataclass(frozen=True)
class SplatError:
    """What drawn pictures lack, and how much more they may.

    Args:
        calibration: Effects of the camera as it was.
        lack: What is left by place of pictures with these effects.
        layers: Spreads of what is left of that, by the rows at which pictures are compared.
        left: Root mean squares, encoded: photos less pictures as drawn, as calibrated, and corrected by other views.
    """

    calibration: tuple[Applied, ...]
    lack: Lack
    layers: Mapping[int, LayerSpread]
    left: tuple[float, float, float]

    def corrected(self, pairs: Pairs) -> Pairs:
        """Drawn pictures, reduced, as the camera would have shown them while all was well."""
        drawn = calibrated(pairs, self.calibration)
        view = plain_view(drawn)
        before = np.clip(drawn.before + self.lack.at(view)[0], 0.0, 1.0)
        return replace(drawn, before=before, again=before)


class SplatResiduals(ImageResiduals):
    """Photos less corrected pictures, in units of the error that these have.

    Args:
        pairs: Pictures from `SplatError.corrected`, and photos.
        error: What they may lack.
        height: Rows, about, at which they are compared.
        expectation: Expectation of the same pictures, where there is one.
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
        """Photos less expected ones, every part in units of its spread. [N, h, w, 3]."""
        plain = super().apart(how)
        return plain if self._spread_of is None else self._spread_of.whitened(plain)

    def replicate(self, rng: np.random.Generator) -> Array:
        """A residual in which nothing has changed, from what is left of the registration's views. [N * h + N, 3 * w]."""
        count, height, width = self.shape
        assert self._spread_of is not None
        white = self._spread_of.replicate(self.mask[..., None], rng)
        return np.concatenate([white.reshape(count * height, 3 * width), np.zeros((count, 3 * width), np.float32)])

    def tells(self, candidate: Candidate) -> bool:
        """Whether an effect can be told at all: drawn pictures have no noise to compare."""
        return super().tells(candidate) and not candidate.effect.noise_only

    def coarse(self) -> ImageResiduals:
        """These views in few rows."""
        return SplatResiduals(self.pairs, self.error, height=COARSE, expectation=self.expectation)


def plain_view(pairs: Pairs) -> ImageResiduals:
    """Drawn pictures and photos with the same spread everywhere."""
    return ImageResiduals(pairs, PhotoNoise(0.5 * _ROUGH**2, 0.0), compare_noise=False)


def calibrated(pairs: Pairs, effects: Sequence[Applied]) -> Pairs:
    """Drawn pictures as a camera with some effects shows them."""
    how = shooting(effects, pairs.edge)
    before = Expectation(pairs).photos(how)
    return replace(pairs, before=before, again=before, poses=how.mount @ pairs.poses)


def calibrate(pairs: Pairs) -> tuple[Applied, ...]:
    """Fit effects of the camera to photos, all together; what lies about and is not drawn is left out."""
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
    """Pictures of about as many pixels as they are compared in: drawn ones hold no finer detail."""
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
    """Learn what drawn pictures lack from photos of the day on which all was well.

    Args:
        registration: Drawn pictures (`before`) and photos (`after`) of that day.

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
    for fold in range(_FOLDS):
        group = [n for n in range(count) if n % _FOLDS == fold]
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
    """Refuse too few photos of the day on which all was well.

    Raises:
        InputError: They are too few.
    """
    if len(registration) < FEWEST:
        raise InputError(
            registration.name or "registration",
            f"there are {len(registration)} photos of the day on which all was well",
            f"Take {FEWEST} or more; see docs/gap_images.md",
        )


def subset(pairs: Pairs, chosen: Sequence[int]) -> Pairs:
    """Some of the views."""
    rows = list(chosen)
    parts = {name: getattr(pairs, name)[rows] for name in ("before", "again", "after", "depths", "poses")}
    return replace(pairs, **parts)
