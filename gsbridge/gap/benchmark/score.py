"""Scoring verdicts against truths: rates with Wilson intervals, and the confusion matrix."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

OUTCOMES = ("right", "covered", "abstained", "missed", "wrong", "quiet", "false_alarm")
"""Named as hidden; ambiguous with the truth inside; nothing named although something was hidden and seen; taken for no
discrepancy; another name, or a set without the truth; silent, or not, where nothing was hidden."""


@dataclass(frozen=True)
class Verdict:
    """One diagnosed case.

    Args:
        hidden: Names of what was hidden, with joints where the mechanism has several.
        units: Its size.
        verdict: Word of `gsbridge.gap.identify.VERDICTS`.
        named: Names of the best explanation.
        sets: Names of each explanation that the data cannot decide between.
        simulations: After the bank.
        closure: Share of the gap that the named effects close on `verify`; None where nothing was named.
    """

    hidden: frozenset[str]
    units: float
    verdict: str
    named: frozenset[str]
    sets: tuple[frozenset[str], ...] = ()
    simulations: int = 0
    closure: float | None = None


def outcome(case: Verdict, known: bool = True) -> str:
    """One of `OUTCOMES`.

    Args:
        case: The case.
        known: Whether what is hidden is in the catalogue; where it is not, only abstaining is right.
    """
    silent = case.verdict in ("no_discrepancy", "not_enough_excitation")
    if not case.hidden:
        return "quiet" if silent else "false_alarm"
    if silent:
        return "missed"
    if case.verdict == "none_of_the_known":
        return "abstained"
    if case.verdict == "ambiguous":
        return "covered" if known and case.hidden in case.sets else "wrong"
    return "right" if known and case.named == case.hidden else "wrong"


def wilson(successes: int, total: int, deviations: float = 1.96) -> tuple[float, float]:
    """95 % interval of a rate.

    Source: Wilson, Journal of the American Statistical Association 22, 1927.
    """
    if total == 0:
        return 0.0, 1.0
    share, square = successes / total, deviations**2
    middle = (share + square / (2 * total)) / (1 + square / total)
    half = deviations * np.sqrt(share * (1 - share) / total + square / (4 * total**2)) / (1 + square / total)
    return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))


def rate(successes: int, total: int) -> dict[str, Any]:
    """A rate with count and interval."""
    low, high = wilson(successes, total)
    return {"value": successes / total if total else None, "n": total, "ci95_low": low, "ci95_high": high}


def score(cases: Iterable[Verdict], unknown: frozenset[str], above: float = 5.0) -> dict[str, Any]:
    """Figures of one tier.

    Args:
        cases: Verdicts.
        unknown: Names (without joints) that are in no catalogue.
        above: Units from which on naming counts.
    """
    cases = list(cases)
    strange = [case for case in cases if any(name.split(":")[0] in unknown for name in case.hidden)]
    empty = [case for case in cases if not case.hidden]
    single = [case for case in cases if len(case.hidden) == 1 and case not in strange]
    several = [case for case in cases if len(case.hidden) > 1 and case not in strange]
    large = [case for case in single if case.units >= above]
    counted = Counter(outcome(case) for case in large)
    every = Counter(outcome(case) for case in single)
    closures = [case.closure for case in large if outcome(case) == "right" and case.closure is not None]
    confusion = Counter((" + ".join(sorted(case.hidden)) or "nothing", _answer(case)) for case in cases)
    return {
        "named_right": rate(counted["right"], len(large)),
        "named_or_covered": rate(counted["right"] + counted["covered"], len(large)),
        "wrong": rate(every["wrong"], len(single)),
        "false_alarm": rate(sum(outcome(case) == "false_alarm" for case in empty), len(empty)),
        "unknown_abstained": rate(sum(outcome(case, False) == "abstained" for case in strange), len(strange)),
        "unknown_wrong": rate(sum(outcome(case, False) == "wrong" for case in strange), len(strange)),
        "set_f1": _f1(several),
        "closure_median": float(np.median(closures)) if closures else None,
        "closure_tenth": float(np.quantile(closures, 0.1)) if closures else None,
        "simulations_median": float(np.median([case.simulations for case in cases])) if cases else None,
        "simulations_most": max((case.simulations for case in cases), default=None),
        "confusion": [{"hidden": a, "answer": b, "cases": n} for (a, b), n in sorted(confusion.items())],
    }


def _answer(case: Verdict) -> str:
    """What was said, in one cell of the confusion matrix."""
    if case.verdict == "named":
        return " + ".join(sorted(case.named))
    if case.verdict == "ambiguous":
        return "one of " + " | ".join(" + ".join(sorted(item)) for item in case.sets)
    return case.verdict


def _f1(cases: list[Verdict]) -> dict[str, Any]:
    """F1 over sets of effects; what is only ambiguous counts as not named."""
    hits = sum(len(case.hidden & case.named) for case in cases if case.verdict == "named")
    said = sum(len(case.named) for case in cases if case.verdict == "named")
    hidden = sum(len(case.hidden) for case in cases)
    return {"value": 2 * hits / (said + hidden) if said + hidden else None, "n": len(cases)}
