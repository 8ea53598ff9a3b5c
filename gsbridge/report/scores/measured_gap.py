"""Figures of the areas about the gap, gathered from the benchmark's scores under the names of `floors.yaml`.

A figure that cannot be formed from what is there is left out, and the `score` rule then counts it as unmet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.files import read_json, write_json
from gsbridge.report.scores.risk_coverage import answered, risk_at, riskier
from gsbridge.statistics import wilson_interval

OURS = "gsbridge"
WHERE = "results/gap-benchmark/"

POOLED = {
    "false_alarm": "gap_false_alarm",
    "unknown_abstained": "gap_unknown_abstained",
    "interval_coverage": "gap_interval_coverage",
}
"""Rates that are pooled over the cases of several tiers, and the names of their floors."""

PHOTOS = "t4"
"""Tier whose cases are pictures; the cases of all other tiers are simulated motions."""

REAL = "results/benchmarks/gap_measured.json"

ARM = "results/benchmarks/gap_so101.json"

_FIRST = 3
"""Number of top entries of an account that should stay the same when the motions behind it are exchanged."""

MISMATCH = "results/benchmarks/gap_mismatch.json"

_SURE = ("named", "likely, not proven")
"""Verdicts with which the first line of an account counts as an answer."""

ARMS = ("t1", "t2")
"""Tiers of arms, whose truths are physics engines; names and closures are scored on their cases."""

MOVING = ("t0", "t1", "t2", "t7")
"""Tiers of axes, arms and other machines, which the area `gap` is about; bodies and photos have figures of their own."""

_STATISTICS = ("false_alarm", "interval_coverage")
"""Rates that depend on noise and its treatment, not on how hard naming is; they are pooled over all tiers in `MOVING`."""


def read_tiers(scores: Sequence[str | Path]) -> dict[str, dict[str, Any]]:
    """Read the scores, by tier.

    Raises:
        InputError: A file is missing or damaged.
    """
    found = [read_json(path) for path in scores]
    return {content["tier"]: content for content in found}


def gap_figures(tiers: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Make the measured figures in the floors' units, from the scored split alone.

    Args:
        tiers: Scores by tier.
    """
    ours = {tier: found["methods"][OURS] for tier, found in tiers.items() if found["split"] == "scored"}
    moving = {tier: scores for tier, scores in ours.items() if tier in MOVING}
    out: dict[str, dict[str, Any]] = {}
    for tier, scores in ours.items():
        out[f"gap_named_right_{tier}"] = _percent(scores["named_right"])
        out[f"gap_wrong_{tier}"] = _percent(scores["named_wrong"])
        for key in ("told_right", "told_wrong"):
            out[f"gap_{key}_{tier}"] = _percent(scores[key])
        out[f"gap_interval_coverage_{tier}"] = _percent(scores["interval_coverage"])
        out[f"gap_interval_coverage_upper_{tier}"] = out[f"gap_interval_coverage_{tier}"]
        out[f"gap_false_alarm_{tier}"] = _percent(scores["false_alarm"])
        for key in ("simulations_most", "bank_most"):
            out[f"gap_{key}_{tier}"] = _plain(scores[key], len(scores["list"]))
    dynamic = [scores for tier, scores in ours.items() if tier in ARMS]
    for key, name in POOLED.items():
        over = list(moving.values()) if key in _STATISTICS else dynamic
        out[name] = _percent(pooled([scores[key] for scores in over]))
    sets = [(scores["set_f1"]["value"], scores["set_f1"]["n"]) for scores in dynamic if scores["set_f1"]["value"] is not None]
    total = sum(n for _, n in sets)
    out["gap_set_f1"] = _plain(sum(value * n for value, n in sets) / total if total else None, total)
    for key in ("closure_median", "closure_tenth"):
        # Quantiles of several tiers cannot be pooled, so the worst tier counts.
        values = [scores[key] for scores in dynamic if scores[key] is not None]
        out[f"gap_{key}"] = _plain(min(values, default=None), sum(scores["named_right"]["n"] for scores in dynamic))
    for key in ("simulations_most", "bank_most"):
        values = [scores[key] for scores in moving.values() if scores[key] is not None]
        out[f"gap_{key}"] = _plain(max(values, default=None), sum(len(scores["list"]) for scores in moving.values()))
    out["gap_interval_coverage_upper"] = out["gap_interval_coverage"]
    out |= baseline_figures({tier: found for tier, found in tiers.items() if tier in ARMS and found["split"] == "scored"})
    return {name: figure for name, figure in out.items() if figure["value"] is not None}


def baseline_figures(tiers: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Compare the other methods with this package on the same cases of arms, and count those that are beaten.

    `gap_baselines_beaten` counts a baseline that names more effects wrongly and no more effects rightly than this package.
    `gap_risks_beaten` counts one whose answers are wrong significantly more often at equal coverage, that is if it answers as
    many cases as this package names, those it is surest of (see `riskier`). A baseline that did not run in every tier is left
    out.

    Args:
        tiers: Scores by tier.
    """
    if not tiers:
        return {}
    methods = list(dict.fromkeys(name for found in tiers.values() for name in found["methods"]))
    methods = [name for name in methods if all(name in found["methods"] for found in tiers.values())]
    rates = {
        key: {name: _percent(pooled([found["methods"][name][key] for found in tiers.values()])) for name in methods}
        for key in ("named_right", "named_wrong")
    }
    right, wrong = ({name: rate["value"] for name, rate in rates[key].items()} for key in ("named_right", "named_wrong"))
    # A split without effects of five units has no rate of right names.
    others = [name for name in methods if name != OURS and right[name] is not None and wrong[name] is not None]
    if OURS not in methods or right[OURS] is None or wrong[OURS] is None or not others:
        return {}
    beaten = [name for name in others if wrong[name] > wrong[OURS] and right[name] <= right[OURS]]
    lists = {name: [row for found in tiers.values() for row in found["methods"][name]["list"]] for name in (OURS, *others)}
    coverage = answered(lists[OURS])
    risks = {name: risk_at(rows, coverage) for name, rows in lists.items()}
    shown = {name: 100 * risk for name, risk in risks.items() if risk is not None}
    worse = [name for name in others if riskier(lists[name], lists[OURS], coverage)]
    cases = rates["named_wrong"][OURS]["n"]
    return {
        "gap_baselines_beaten": _plain(float(len(beaten)), cases),
        "gap_risks_beaten": _plain(float(len(worse)) if OURS in shown else None, len(lists[OURS])),
        "gap_coverage": _plain(100 * coverage, len(lists[OURS])),
        "gap_risk_at_coverage": {**_plain(shown.get(OURS), len(lists[OURS])), "by_scene": shown},
        "gap_baselines_wrong": {**_plain(min(wrong[name] for name in others), cases), "by_scene": wrong},
        "gap_baselines_right": {
            **_plain(max(right[name] for name in others), rates["named_right"][OURS]["n"]),
            "by_scene": right,
        },
    }


def real_figures(found: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Make the figures on real logs, from the results of `benchmarks/gap_measured.py`.

    Args:
        found: Figures of that benchmark, by kind of logs; kinds that did not run are left out.
    """
    out: dict[str, dict[str, Any]] = {}
    if "tosses" in found:
        tosses, held_out = found["tosses"], found["tosses"]["tosses"]["verify"]
        names = [effect["name"] for effect in tosses["effects"]]
        named = tosses["verdict"] == "named" and "contact_friction" in names
        out["gap_tosses_named"] = {**_plain(float(named), held_out), "where": REAL}
        if tosses["verify"]:
            out["gap_tosses_closed"] = {**_plain(100 * tosses["verify"]["removed"], held_out), "where": REAL}
    if "pendulum" in found:
        out["gap_pendulum_unnamed"] = {**_plain(float(found["pendulum"]["verdict"] != "named"), 1), "where": REAL}
    return out


def arm_figures(found: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Make the figures on a real arm's motions, from the results of `benchmarks/gap_so101.py`.

    The benchmark exchanges the motions that the diagnosis learns from; each figure is the lowest value over these exchanges.

    Args:
        found: Figures that the program wrote.
    """
    turns = [turn for turn in found["turns"] if turn["judged"]]
    if not turns:
        return {}
    motions = len(turns[0]["judged"])
    firsts = [frozenset(entry["label"] for entry in turn["account"][:_FIRST]) for turn in turns]
    values = {
        "gap_so101_median": 100 * min(turn["median"] for turn in turns),
        "gap_so101_worst": 100 * min(turn["worst"] for turn in turns),
        "gap_so101_kept": float(min(len(first & firsts[0]) for first in firsts)),
    }
    return {name: {**_plain(value, motions), "turns": len(turns), "where": ARM} for name, value in values.items()}


def logged_figures(real: str | Path | None, arm: str | Path | None) -> dict[str, dict[str, Any]]:
    """Make the figures on logs of real machines.

    Args:
        real: File with the input of `real_figures`; None where that benchmark did not run.
        arm: File with the input of `arm_figures`; None where that benchmark did not run.

    Raises:
        InputError: A file is missing or damaged.
    """
    found = {} if real is None else real_figures(read_json(real))
    return found | ({} if arm is None else arm_figures(read_json(arm)))


def mismatch_figures(found: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Make the figures on truths whose laws the diagnosis does not know (tier T6), from `benchmarks/gap_mismatch.py`.

    Args:
        found: Figures that the program wrote.
    """
    hidden = [row for row in found["cases"] if row["right"]]
    free = [row for row in found["cases"] if not row["right"]]
    counts = {
        "gap_first_right_t6": (sum(row["first_right"] and row["first_verdict"] in _SURE for row in hidden), len(hidden)),
        "gap_wrong_t6": (sum(row["outcome"] == "wrong" for row in hidden), len(hidden)),
        "gap_false_alarm_t6": (sum(row["outcome"] == "false_alarm" for row in free), len(free)),
    }
    named = [row for row in hidden if row["kind"] == "single"]
    counts["gap_named_right_t6"] = (sum(row["outcome"] == "right" for row in named), len(named))
    truths = [held for row in hidden for held in row["held"].values()]
    counts["gap_interval_coverage_t6"] = (sum(truths), len(truths))
    return {name: {**_percent(_rate(good, total)), "where": MISMATCH} for name, (good, total) in counts.items() if total}


def pooled(rates: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Pool a rate over the cases of several tiers; the value is None without cases."""
    total = sum(rate["n"] for rate in rates)
    if not total:
        return {"value": None, "n": 0}
    return _rate(sum(round(rate["value"] * rate["n"]) for rate in rates if rate["n"]), total)


def _rate(good: int, total: int) -> dict[str, Any]:
    """Make a rate with Wilson's 95 % interval, 0..1."""
    low, high = wilson_interval(good, total)
    return {"value": good / total, "n": total, "ci95_low": low, "ci95_high": high}


def _percent(rate: Mapping[str, Any]) -> dict[str, Any]:
    """Turn a rate into a figure in percent."""
    if rate["value"] is None:
        return _plain(None, 0)
    interval = [100 * rate["ci95_low"], 100 * rate["ci95_high"]]
    return {**_plain(100 * rate["value"], rate["n"]), "interval": interval, "interval_of": "Wilson, 95 %"}


def _plain(value: float | None, count: int) -> dict[str, Any]:
    return {"value": value, "n": count, "cases": count, "where": WHERE}


def write_gap_figures(
    out: str | Path,
    scores: Sequence[str | Path],
    *,
    preset: str,
    real: str | Path | None = None,
    arm: str | Path | None = None,
    mismatch: str | Path | None = None,
) -> None:
    """Write the measured figures.

    Args:
        out: `scores/measured/gap.json`.
        scores: `scores.json` of each tier.
        preset: Preset that the tiers ran with.
        real: See `logged_figures`; None where the logs are not on this machine.
        arm: See `logged_figures`; None likewise.
        mismatch: Figures of tier T6, see `mismatch_figures`; None where it did not run.

    Raises:
        InputError: A file is missing or damaged.
    """
    figures = gap_figures(read_tiers(scores))
    figures |= logged_figures(real, arm)
    if mismatch is not None:
        figures |= mismatch_figures(read_json(mismatch))
        # The rate of false alarms is over all cases of machines with nothing hidden, those of T6 included.
        alarms = [figures[name] for name in ("gap_false_alarm", "gap_false_alarm_t6") if name in figures]
        figures["gap_false_alarm"] = _percent(pooled([{**rate, "value": rate["value"] / 100} for rate in alarms]))
    write_json(out, {"preset": preset, "figures": figures})
