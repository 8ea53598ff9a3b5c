"""Risk against coverage: how often a method is wrong where it answers only what it is surest of.

Source: El-Yaniv and Wiener, Journal of Machine Learning Research 11, 2010.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gsbridge.geometry import Array


def risk_coverage(rows: Sequence[Mapping[str, Any]]) -> tuple[Array, Array]:
    """The curve of one method: every right to abstain that it could have been given, seen with hindsight.

    Cases in which nothing is hidden, or nothing that a catalogue holds, count, and any answer to them is wrong.

    Args:
        rows: Cases as scores list them, with `confidence` (None for no answer) and `guessed_right`.

    Returns:
        Coverage, the share of all cases that are answered, [K], ascending; and risk, the share of wrong ones among them, [K].
        Answers of equal confidence are given together.
    """
    answers = sorted((-row["confidence"], not row["guessed_right"]) for row in rows if row["confidence"] is not None)
    if not answers:
        return np.empty(0), np.empty(0)
    confidence, wrong = (np.array(values, dtype=np.float64) for values in zip(*answers, strict=True))
    ends = np.flatnonzero(np.append(np.diff(confidence) != 0, True)) + 1
    return ends / len(rows), np.cumsum(wrong)[ends - 1] / ends


def risk_at(rows: Sequence[Mapping[str, Any]], coverage: float) -> float | None:
    """Risk of a method at a coverage, between two points of its curve by the straight line of wrong answers.

    Args:
        rows: As `risk_coverage` takes them.
        coverage: Share of all cases that it shall answer; one that answers less is taken at its most.

    Returns:
        The risk; None where it answers nothing.
    """
    shares, risks = risk_coverage(rows)
    if not len(shares):
        return None
    wanted = min(coverage, float(shares[-1]))
    if wanted <= 0.0:
        return float(risks[0])
    wrong = np.interp(wanted, np.append(0.0, shares), np.append(0.0, shares * risks))
    return float(wrong / wanted)


def answered(rows: Sequence[Mapping[str, Any]]) -> float:
    """Share of the cases in which a method itself chose to name something."""
    return sum(row["verdict"] == "named" for row in rows) / len(rows) if rows else 0.0
