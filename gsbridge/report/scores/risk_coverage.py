"""Risk against coverage: how often a method is wrong where it answers only what it is surest of.

Source: El-Yaniv and Wiener, Journal of Machine Learning Research 11, 2010.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from gsbridge.geometry import Array

Rows = Sequence[Mapping[str, Any]]
"""Cases as scores list them, with `sureness` ({measure: value}, empty for no answer), `guessed_right` and `verdict`."""

LEVEL = 0.05
"""P-value below which one method's answers count as wrong more often than another's."""


def measures(rows: Rows) -> list[str]:
    """List the measures of sureness that a method states for every one of its answers."""
    answers = [set(row["sureness"]) for row in rows if row["sureness"]]
    return sorted(set.intersection(*answers)) if answers else []


def risk_coverage(rows: Rows, measure: str) -> tuple[Array, Array]:
    """Make the curve of one method: coverage and risk at every threshold on one measure of how sure it is.

    The thresholds are set with hindsight. Cases that hide nothing, or only effects that no catalogue holds, count, too: any
    answer to them is wrong.

    Args:
        rows: Cases of the method.
        measure: One of `measures`.

    Returns:
        Coverage, the share of all cases that are answered, [K], ascending; and risk, the share of wrong ones among them, [K].
        Equally sure answers share one point.
    """
    answers = sorted((-row["sureness"][measure], not row["guessed_right"]) for row in rows if row["sureness"])
    sure, wrong = (np.array(values, dtype=np.float64) for values in zip(*answers, strict=True))
    ends = np.flatnonzero(np.append(np.diff(sure) != 0, True)) + 1
    return ends / len(rows), np.cumsum(wrong)[ends - 1] / ends


def best_measure(rows: Rows, coverage: float) -> str | None:
    """Find the measure by which a method is wrong least often at a coverage; None where the method answers nothing."""
    return min(measures(rows), key=lambda name: _wrong(rows, name, coverage), default=None)


def risk_at(rows: Rows, coverage: float) -> float | None:
    """Risk of a method at a coverage, by the measure that serves it best there.

    Args:
        rows: Cases of the method.
        coverage: Share of all cases to answer; a method that answers fewer is taken at its largest coverage.

    Returns:
        The risk; None where the method answers nothing, or the coverage is 0.
    """
    measure = best_measure(rows, coverage)
    shown = min(coverage, most_covered(rows))
    return None if measure is None or shown <= 0.0 else _wrong(rows, measure, coverage) / (shown * len(rows))


def most_covered(rows: Rows) -> float:
    """Largest share of the cases that a method can answer."""
    return sum(bool(row["sureness"]) for row in rows) / len(rows) if rows else 0.0


def answered(rows: Rows) -> float:
    """Share of the cases in which a method itself chose to name something."""
    return sum(row["verdict"] == "named" for row in rows) / len(rows) if rows else 0.0


def riskier(rows: Rows, than: Rows, coverage: float) -> bool:
    """Whether a method's answers are wrong more often than another's, at a coverage or at the largest that both reach.

    This is Fisher's exact test, one-sided, on wrong and right answers. It does not use that both methods are judged on the same
    cases, so that it errs towards False.

    Args:
        rows: Cases of the method.
        than: Cases of the other method.
        coverage: Share of all cases.
    """
    shown = min(coverage, most_covered(rows), most_covered(than))
    mine, theirs = best_measure(rows, shown), best_measure(than, shown)
    if mine is None or theirs is None or shown <= 0.0:
        return False
    counts = [(_wrong(some, name, shown), shown * len(some)) for some, name in ((rows, mine), (than, theirs))]
    table = [[round(wrong), round(total) - round(wrong)] for wrong, total in counts]
    return bool(stats.fisher_exact(np.array(table), alternative="greater").pvalue < LEVEL)


def _wrong(rows: Rows, measure: str, coverage: float) -> float:
    """Number of wrong answers at a coverage, or at the largest there is; linear between two points of the curve."""
    shares, risks = risk_coverage(rows, measure)
    return float(np.interp(coverage, np.append(0.0, shares), np.append(0.0, shares * risks)) * len(rows))
