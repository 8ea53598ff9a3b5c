"""How well something that is hidden in a thrown body shows: in units of the smallest gap that throws can tell from none.

What shows is a residual. The model without the effect replays the truth's throws from the starts that their log tells, and each
moment's distance between replay and log counts by what the same replay shows at that moment where nothing is hidden: noise,
chaos and what sets the two engines apart. A unit means the same for all effects, then, also for those that change where or
when something is logged. No effect of the diagnosis is tried here, so that nothing is sized by whether it would be named.
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
"""A unit is this many standard errors of the mean over the throws of a role, of distances in units of what is usual."""

_PROBES = 30
"""Throws by which it is measured."""


class BodyVisibility:
    """Measures how well something shows in throws of one body.

    Args:
        model: Content of the model's file, without what is hidden.
        files: Files that the model names, by name.
        bare: The truth without what is hidden.
        count: Throws of a role.
        seed: Seed of the throws that are looked at.
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
        """How much farther than usual throws of a scene are from their replay by the bare model, in units.

        Infinitely far where one runs away.
        """
        try:
            thrown = self._replay(scene)
        except RunawayError:
            return np.inf
        return max(float(self._sizes(thrown).mean()) - self._usual, 0.0) / self._limit

    def _replay(self, scene: ThrowScene) -> ThrowReplay:
        return ThrowReplay(self._body, throw_box(scene, _PROBES, self._seed), self._duration)

    def _sizes(self, replay: ThrowReplay) -> Array:
        """Mean distance of each throw, in units of what is usual at each moment. [N]."""
        rows = zip(replay.flights(), replay.measured, replay.attitudes, touch_clocks(replay), strict=True)
        return np.array(
            [(point_distances(flight, at, to, replay.radius) / self._spread(since)).mean() for flight, at, to, since in rows]
        )
