"""The learning curve: one CSV row per evaluation, which also summarises the training since the last row."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from gsbridge.files import atomic_file
from gsbridge.policy.evaluation import Evaluation
from gsbridge.tasks.poses import QUADRANTS

Row = dict[str, float | None]
"""Figures by column; None if the algorithm does not have one."""

PARTS = ("environment", "act", "update", "evaluate")
LEARNED = (
    *("target_mean", "target_max", "alarm", "surprise_max", "critic_loss", "advantage"),
    *("imitation_loss", "imitated_share", "position_loss", "entropy"),
)
COLUMNS = (
    *("step", "episode", "update", "success"),
    *(f"success_q{quadrant}" for quadrant in QUADRANTS),
    *("length", "q_start", "return_start", "training_success", "controller_success"),
    *("actor_share", "lambda", "alpha"),
    *LEARNED,
    *(f"cpu_{part}_s" for part in PARTS),
)
"""`target_max`, `surprise_max`: largest since the last row; other learned figures: means. `surprise_max` is the largest
-log pi of a controller's action, nats; `advantage` the mean of Q(controller) - Q(actor); `alarm` the share of updates whose
targets exceed the largest return. `cpu_*_s`: CPU seconds since the beginning of the training, by part of the work."""

_HIGHEST = ("target_max", "surprise_max")


class Meter:
    """Figures since the last row."""

    def __init__(self) -> None:
        self._sums: dict[str, float] = {}
        self._counts: dict[str, int] = {}

    def see(self, figures: Mapping[str, float]) -> None:
        """Add figures; the largest value is kept for those in `_HIGHEST`, the mean for all others."""
        for name, value in figures.items():
            if name in _HIGHEST:
                self._sums[name] = max(self._sums.get(name, -np.inf), value)
                self._counts[name] = 1
            else:
                self._sums[name] = self._sums.get(name, 0.0) + value
                self._counts[name] = self._counts.get(name, 0) + 1

    def take(self, *names: str) -> Row:
        """Return the figures by name, None where there were none, and start again."""
        out = {name: self._sums[name] / self._counts[name] if name in self._sums else None for name in names}
        self._sums.clear()
        self._counts.clear()
        return out


class TrainingClock:
    """Counts CPU seconds by part of the work, and wall-clock seconds of all parts but evaluation.

    Args:
        seconds: CPU seconds to go on counting from, by part.
        wall: Wall-clock seconds to go on counting from.
        workers: Returns the CPU seconds of the worker processes, which count like those of this process.
    """

    def __init__(
        self, seconds: Mapping[str, float] | None = None, wall: float = 0.0, workers: Callable[[], float] = lambda: 0.0
    ) -> None:
        self._workers = workers
        self.seconds = {part: float((seconds or {}).get(part, 0.0)) for part in PARTS}
        self.wall = float(wall)

    @contextmanager
    def on(self, part: str) -> Iterator[None]:
        """Count the seconds of a block as those of a part."""
        begin, now = time.process_time() + self._workers(), time.perf_counter()
        try:
            yield
        finally:
            self.seconds[part] += time.process_time() + self._workers() - begin
            if part != "evaluate":
                self.wall += time.perf_counter() - now


def evaluation_row(evaluation: Evaluation) -> Row:
    """Figures of an evaluation, by column."""
    expected = evaluation.expected.mean()
    return {
        "success": evaluation.rate,
        **{f"success_q{quadrant}": _known(evaluation.rate_in(quadrant)) for quadrant in QUADRANTS},
        "length": float(evaluation.steps.mean()),
        "q_start": _known(expected),
        "return_start": float(evaluation.returns.mean()),
    }


def write_curve(path: str | Path, rows: Sequence[Row]) -> None:
    """Write all rows, whole or not at all; numbers are exact, and unknown figures empty."""
    with atomic_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, restval="", lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: "" if value is None else repr(value) for name, value in row.items()})


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
