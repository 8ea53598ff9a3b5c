"""Photos of one role against pictures of the model: residuals in units of the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gsbridge.gap.image.common import directions
from gsbridge.gap.image.floor import Flats, Floor, slopes_of
from gsbridge.gap.image.model import ImageModel
from gsbridge.gap.image.shots import Shots
from gsbridge.gap.system import Applied
from gsbridge.geometry import Array
from gsbridge.scene.shooting import Shooting


@dataclass(frozen=True, eq=False)
class View:
    """Photos and the model they are compared with.

    Args:
        model: The model.
        shots: The photos.
        floor: What they differ by if nothing is missing.
    """

    model: ImageModel
    shots: Shots
    floor: Floor

    def shooting(self, effects: Sequence[Applied] = ()) -> Shooting:
        """How pictures are taken with some effects, as soft as the reference says."""
        return self.model.shooting(effects, self.floor.softness)

    def pictures(self, effects: Sequence[Applied] = ()) -> Array:
        """Expected photos. [N, H, W, 3]."""
        return self.model.expected(self.shots, self.shooting(effects))

    @cached_property
    def plain(self) -> Array:
        """Without further effects."""
        return self.pictures()

    @cached_property
    def _slopes(self) -> Array:
        return slopes_of(self.plain)

    @cached_property
    def sizes(self) -> Array:
        """Deviations of residuals, from the plain pictures. [N, H, W]."""
        return self.floor.sizes(self._slopes) / np.maximum(self.covered, 1e-6)

    @cached_property
    def flats(self) -> Flats:
        """Where grain is measured."""
        return Flats.of(self.plain, self._slopes, self.covered > 0)

    @cached_property
    def extra(self) -> float:
        """Variance of noise beyond the reference's, in units of the floor: residuals must not count noise as shape."""
        found = self.flats.variances(self.shots.photos - self.plain)
        more = np.nanmedian(found - self.floor.grain[0] - self.floor.grain[1] * self.flats.levels)
        return float(max(more, 0.0) / np.median(self.floor.sizes(self._slopes) ** 2))

    def grain(self, how: Shooting) -> Array:
        """Logarithm of the variance of grain that is expected. [N, L, 3]."""
        dark, light = self.floor.grain
        level = np.clip(self.flats.levels, 0.0, 1.0)
        return np.log(dark + how.read_noise + (light + how.shot_noise) * level)

    def residual(self, effects: Sequence[Applied] = ()) -> Array:
        """Photos minus pictures in units of the floor, a row per line of a photo, then the grain of every photo.

        [N * H + N, 3 * W].
        """
        how = self.shooting(effects)
        apart = self.shots.photos - self.model.expected(self.shots, how)
        rough = np.log(self.flats.variances(apart)) - self.grain(how)
        return self.stack(apart, np.nan_to_num(rough))

    def stack(self, apart: Array, rough: Array) -> Array:
        """Encoded differences and differences of the logarithm of grain as one table; see `residual`."""
        rows = self.rows(apart, rough)
        count, height, width = self.shots.photos.shape[:3]
        body, grain = rows[:, : 3 * height * width], rows[:, 3 * height * width :]
        return np.concatenate([body.reshape(count * height, 3 * width), grain])

    def rows(self, apart: Array, rough: Array) -> Array:
        """The same with the numbers of each photo together. [N, (H + 1) * 3 * W]."""
        rows = self.white(apart, rough)
        if self.floor.common:
            axes, shares = self._common
            along = shares[:, :, None] * (axes.transpose(0, 2, 1) @ rows[:, :, None])
            rows = rows - (axes @ along)[:, :, 0]
        return rows

    def white(self, apart: Array, rough: Array) -> Array:
        """The same before what pictures are off by as a whole is weighed. [N, (H + 1) * 3 * W]."""
        white = self.floor.whiten(apart, self.sizes, self.extra)
        rough = rough * self.flats.weights(self.floor.scatter) / np.sqrt(self.floor.scale)
        count, width = white.shape[0], white.shape[2]
        grain = np.zeros((count, 3 * width), np.float32)
        grain[:, : rough[0].size] = rough.reshape(count, -1)
        return np.concatenate([white.reshape(count, -1), grain], axis=1)

    @cached_property
    def _common(self) -> tuple[Array, Array]:
        """Axes in which pictures are off as a whole, and the share by which lengths along them shrink. [N, D, M], [N, M]."""
        columns = directions(self) * np.sqrt(np.asarray(self.floor.common) / self.floor.scale).astype(np.float32)
        # By orthogonal columns: squares of lengths that differ by thousands leave nothing of the short ones.
        whole, small = np.linalg.qr(columns)
        turn, lengths, _ = np.linalg.svd(small.astype(np.float64))
        return whole @ turn.astype(np.float32), (1.0 - 1.0 / np.sqrt(1.0 + lengths**2)).astype(np.float32)

    @cached_property
    def covered(self) -> Array:
        """Where splats leave no hole: elsewhere nothing is compared. [N, H, W]."""
        return self.model.photographer.covered(self.shots.track, self.shots.times)

    def by_photo(self, table: Array) -> Array:
        """A residual with the numbers of each photo together. [N * H + N, 3 * W] -> [N, (H + 1) * 3 * W]."""
        count, height = self.shots.photos.shape[:2]
        body = table[: count * height].reshape(count, -1)
        return np.concatenate([body, table[count * height :].reshape(count, -1)], axis=1)
