"""Scores of findings against truths: rates with Wilson intervals, detection curves, calibration, and a confusion matrix."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.files import read_json, write_json
from gsbridge.gap.benchmark.verdicts import OUTCOMES, JudgedCase, read_verdicts
from gsbridge.statistics import wilson_interval

LARGE = 5.0
"""Smallest size of an effect, in units of the detection limit, at which it must be named."""

_SIZES = (0.0, 2.0, LARGE, 10.0, 50.0)
"""Lower edges of the classes of sizes in which outcomes are counted, in units of the detection limit."""

_BINS = (0.0, 0.5, 0.8, 0.95, 1.0)
"""Edges of the bins of stated probabilities in the calibration."""


def rate(successes: int, total: int) -> dict[str, Any]:
    """Return a rate with its count and 95 % interval; its value is None if nothing was counted."""
    low, high = wilson_interval(successes, total) if total else (0.0, 1.0)
    return {"value": successes / total if total else None, "n": total, "ci95_low": low, "ci95_high": high}


def score_findings(
    cases: str | Path, truths: str | Path, findings: Mapping[str, Sequence[str | Path]], large: float = LARGE
) -> dict[str, Any]:
    """Score the findings of several methods on one tier.

    Args:
        cases: Folder of cases that `generate_cases` made.
        truths: Folder of their truths, from the same call.
        findings: Folders of findings by method.
        large: Smallest size of an effect, in units of the detection limit, at which it must be named.

    Raises:
        InputError: A truth was changed, or a finding is missing.
    """
    manifest = read_json(Path(cases) / "manifest.json")
    methods = {method: score(read_verdicts(cases, truths, folders), large) for method, folders in findings.items()}
    drawn = {"tier": manifest["tier"], "split": manifest["split"], "seal": manifest.get("seal")}
    return {**drawn, "cases": len(manifest["cases"]), "methods": methods}


def score(verdicts: Iterable[JudgedCase], large: float = LARGE) -> dict[str, Any]:
    """Compute the scores of one method on one tier.

    Args:
        verdicts: Judged cases of the tier.
        large: Smallest size of an effect, in units of the detection limit, at which it must be named.
    """
    cases = list(verdicts)
    hidden = [case for case in cases if case.hidden]
    empty = [case for case in cases if not case.hidden]
    strange = [case for case in hidden if not case.known]
    known = [case for case in hidden if case.known]
    single, several = [c for c in known if len(c.hidden) == 1], [c for c in known if len(c.hidden) > 1]
    plain = [case for case in single if case.kind == "single" and case.units >= large]
    right = [case for case in known if case.outcome == "right" and case.verdict == "named"]
    closures = [case.closure for case in right if case.closure is not None and case.units >= large]
    left = [case.left for case in right if case.left is not None]
    covers = [inside for case in right for inside in case.covers]
    runs = [case.simulations for case in cases]
    return {
        "named_right": _rate(plain, "right"),
        "named_or_covered": rate(sum(case.outcome in ("right", "covered") for case in plain), len(plain)),
        "told_right": rate(sum(case.outcome == "right" or (case.likely and case.guessed_right) for case in plain), len(plain)),
        "told_wrong": rate(sum(case.likely and not case.guessed_right for case in cases), len(cases)),
        "named_wrong": _rate(single, "wrong"),
        "named_wrong_large": _rate(plain, "wrong"),
        "false_alarm": _rate(empty, "false_alarm"),
        "unknown_abstained": _rate(strange, "abstained"),
        "unknown_wrong": _rate(strange, "wrong"),
        "set_f1": _f1(several),
        "closure_median": _quantile(closures, 0.5),
        "closure_tenth": _quantile(closures, 0.1),
        "closures": len(closures),
        "residual_over_floor_median": _quantile(left, 0.5),
        "interval_coverage": rate(sum(covers), len(covers)),
        "by_parameter": _parameters(right),
        "simulations_median": _quantile(runs, 0.5),
        "simulations_most": max(runs, default=None),
        "bank_most": max((case.bank for case in cases), default=None),
        "seconds_median": _quantile([case.seconds for case in cases], 0.5),
        "seconds_total": float(sum(case.seconds for case in cases)),
        "by_units": _groups([c for c in single if c.kind == "single"], lambda c: _class(c.units), "units"),
        "by_effect": _groups(single, lambda c: next(iter(c.hidden)).split(":")[0], "effect"),
        "by_kind": _groups(cases, lambda c: c.kind, "kind"),
        "confusion": _confusion(cases),
        **_calibration([case for case in known if case.chance is not None and case.verdict in ("named", "ambiguous")]),
        "list": [_row(case) for case in cases],
    }


def _class(units: float) -> float:
    """Return the lower edge of a size's class: in sealed draws and with bodies, sizes vary from case to case."""
    return max(edge for edge in _SIZES if units >= edge)


def _rate(cases: Sequence[JudgedCase], outcome: str) -> dict[str, Any]:
    return rate(sum(case.outcome == outcome for case in cases), len(cases))


def _quantile(values: Sequence[float], share: float) -> float | None:
    return float(np.quantile(values, share)) if values else None


def _groups(cases: Sequence[JudgedCase], of: Callable[[JudgedCase], Any], title: str) -> list[dict[str, Any]]:
    """Return the rates of outcomes in each group of cases."""
    out = []
    for value in sorted({of(case) for case in cases}):
        group = [case for case in cases if of(case) == value]
        out.append({title: value, "n": len(group), **{name: _rate(group, name) for name in OUTCOMES}})
    return out


def _parameters(cases: Sequence[JudgedCase]) -> list[dict[str, Any]]:
    """Return how often 90 % intervals contain the true value, by effect and parameter, with all joints pooled."""
    found: dict[str, list[bool]] = {}
    for case in cases:
        for label, inside in case.parameters.items():
            name, _, parameter = label.rpartition(".")
            found.setdefault(f"{name.split(':')[0]}.{parameter}", []).append(inside)
    return [{"parameter": key, "held": rate(sum(rows), len(rows))} for key, rows in sorted(found.items())]


def _confusion(cases: Sequence[JudgedCase]) -> list[dict[str, Any]]:
    """Count the pairs of hidden effects and answers. Joints are omitted; a right effect at a wrong joint is `elsewhere`."""

    def short(text: str) -> str:
        return " ".join(word.split(":")[0] for word in text.split(" "))

    counts: Counter[tuple[str, str]] = Counter()
    for case in cases:
        hidden = " + ".join(sorted(case.hidden)) or "nothing"
        answer = case.answer
        mistaken = case.outcome == "wrong" and short(answer) == short(hidden)
        counts[short(hidden), f"{short(answer)} elsewhere" if mistaken else short(answer)] += 1
    return [{"hidden": a, "answer": b, "cases": n} for (a, b), n in sorted(counts.items())]


def _calibration(cases: Sequence[JudgedCase]) -> dict[str, Any]:
    """Compare the stated probabilities of being best with how often they are right, and compute the Brier score."""
    said = np.array([case.chance for case in cases], dtype=np.float64)
    true = np.array([case.named in {case.hidden, *case.twins} for case in cases], dtype=np.float64)
    rows = []
    for low, high in zip(_BINS[:-1], _BINS[1:], strict=True):
        inside = (said > low) & (said <= high)
        if inside.any():
            row = {"said_low": low, "said_high": high, "said_mean": float(said[inside].mean())}
            rows.append({**row, "right": rate(int(true[inside].sum()), int(inside.sum()))})
    return {"calibration": rows, "brier": float(((said - true) ** 2).mean()) if len(said) else None}


def _f1(cases: Sequence[JudgedCase]) -> dict[str, Any]:
    """Compute F1 over sets of effects; an ambiguous answer counts as no name, unless it is ambiguous only among twins."""
    said, hits = 0, 0
    for case in cases:
        # An answer that is ambiguous only among the truth and its twins, which no data can tell apart, counts as the truth.
        named = case.hidden if case.outcome == "right" else case.named if case.verdict == "named" else frozenset()
        said, hits = said + len(named), hits + len(case.hidden & named)
    hidden = sum(len(case.hidden) for case in cases)
    return {"value": 2 * hits / (said + hidden) if said + hidden else None, "n": len(cases)}


def _row(case: JudgedCase) -> dict[str, Any]:
    """Return the entry of one case in the list of cases."""
    return {
        "key": case.key,
        "kind": case.kind,
        "hidden": " + ".join(sorted(case.hidden)),
        "units": case.units,
        "verdict": case.verdict,
        "answer": case.answer,
        "outcome": case.outcome,
        "closure": case.closure,
        "simulations": case.simulations,
        "seconds": case.seconds,
        "sureness": dict(case.sureness),
        "guessed_right": case.guessed_right,
        "likely": case.likely,
    }


def score_tier(
    cases: str | Path, truths: str | Path, findings: Sequence[str | Path], methods: Sequence[str], chunks: int, out: str | Path
) -> None:
    """Score the findings of all methods in one tier.

    Args:
        cases: Folder of the cases.
        truths: Folder of the truths.
        findings: Folders of findings: all chunks of the first method, then those of the second, and so on.
        methods: Names of the methods.
        chunks: Number of folders per method.
        out: File to write: `scores.json`.

    Raises:
        InputError: A truth was changed after the diagnosis, or a finding is missing.
    """
    folders = [Path(folder) for folder in findings]
    by_method = {method: folders[k * chunks : (k + 1) * chunks] for k, method in enumerate(methods)}
    write_json(out, score_findings(Path(cases), Path(truths), by_method))
