"""Visibility of effects hidden in a thrown body, in units of the smallest gap that throws can distinguish from none.

The model without the effect replays the truth's throws from the start states in their log. The distance between replay and log
at each moment is divided by the usual distance at that moment if nothing is hidden, which is due to noise, chaos and the
difference between the two engines. A unit therefore means the same for all effects, including those that change where or when
something is logged. No effect of the diagnosis is fitted here, so that sizes do not depend on whether an effect would be named.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.gap.benchmark.body_truth import RunawayError, ThrowScene, throw_box
from gsbridge.gap.contact.body import parse_body
from gsbridge.gap.contact.null import expected_spread
from gsbridge.gap.contact.replay import ThrowReplay, point_distances, touch_clocks
from gsbridge.gap.contact.world import Flight
from gsbridge.geometry import Array

LIMIT = 3.0
"""Size of a unit, in standard errors of the mean distance (relative to the usual one) over the throws of a role."""

_PROBES = 30
"""Number of throws by which visibility is measured."""


class BodyVisibility:
    """Measure of how visible effects are in throws of one body.

    Args:
        model: Content of the model file, without the hidden effects.
        files: Contents of the files that the model names, by name.
        bare: Scene of the truth, without the hidden effects.
        count: Number of throws of a role.
        seed: Seed of the throws by which visibility is measured.
    """

    def __init__(self, model: Mapping[str, Any], files: Mapping[str, str], bare: ThrowScene, count: int, seed: int) -> None:
        with tempfile.TemporaryDirectory() as folder:
            for name, text in files.items():
                (Path(folder) / name).write_text(text, encoding="utf-8")
            self._body = parse_body(dict(model), Path(folder))
        self._seed, self._duration = seed, bare.duration
        replay = self._replay(bare)
        seen = [Flight(at, to, np.zeros(len(at), bool)) for at, to in zip(replay.measured, replay.attitudes, strict=True)]
        self._spread = expected_spread(replay, replay.flights(), [seen])
        sizes = self._sizes(replay)
        self._usual = float(sizes.mean())
        self._limit = LIMIT * float(sizes.std(ddof=1)) / np.sqrt(count)

    def units(self, scene: ThrowScene) -> float:
        """Return by how much throws of a scene are farther than usual from their replay by the bare model, in units.

        The result is infinite if a throw diverges.
        """
        try:
            thrown = self._replay(scene)
        except RunawayError:
            return np.inf
        return max(float(self._sizes(thrown).mean()) - self._usual, 0.0) / self._limit

    def _replay(self, scene: ThrowScene) -> ThrowReplay:
        return ThrowReplay(self._body, throw_box(scene, _PROBES, self._seed), self._duration)

    def _sizes(self, replay: ThrowReplay) -> Array:
        """Return the mean distance of each throw, relative to the usual distance at each moment. [N]."""
        rows = zip(replay.flights(), replay.measured, replay.attitudes, touch_clocks(replay), strict=True)
        return np.array(
            [(point_distances(flight, at, to, replay.radius) / self._spread(since)).mean() for flight, at, to, since in rows]
        )
