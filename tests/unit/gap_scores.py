"""Scores of a benchmark as the scoring rule writes them, made up."""

from gsbridge.statistics import wilson_interval


def rate(good: int, total: int) -> dict:
    """A rate with its interval."""
    low, high = wilson_interval(good, total) if total else (0.0, 1.0)
    return {"value": good / total if total else None, "n": total, "ci95_low": low, "ci95_high": high}


def outcomes(total: int, **counts: int) -> dict:
    """Rates of all outcomes of a group of cases."""
    names = ("right", "covered", "abstained", "missed", "wrong", "quiet", "false_alarm")
    return {name: rate(counts.get(name, 0), total) for name in names}


def method_scores(right: int = 38, wrong: int = 1, alarms: int = 1) -> dict:
    """Of one way of naming: 40 single effects at each of four sizes, of which `right` are named at the larger two."""
    units = []
    of = {"sureness": {"gain": 0.9}, "guessed_right": right > wrong}
    for size, good in ((1, right // 4), (2, right // 2), (5, right), (20, right)):
        bad = wrong if size == 5 else 0
        left = 40 - good - bad
        counts = {"right": good, "covered": left // 2, "wrong": bad, "abstained": left - left // 2, "missed": 0}
        units.append({"units": size, **{name: rate(count, 40) for name, count in counts.items()}})
    common = {"kind": "single", "units": 5, "verdict": "named", "simulations": 80, "seconds": 9.0}
    wrong_case = {"key": "t2-007", "hidden": "viscous:a2", "answer": "gain_d:a2", "outcome": "wrong", "closure": 0.4}
    right_case = {"key": "t2-008", "hidden": "coulomb:a4", "answer": "coulomb:a4", "outcome": "right", "closure": 0.95}
    return {
        "named_right": rate(2 * right, 80),
        "named_or_covered": rate(min(2 * right + 2, 80), 80),
        "told_right": rate(2 * right, 80),
        "told_wrong": rate(0, 400),
        "named_wrong": rate(wrong, 160),
        "false_alarm": rate(alarms, 160),
        "unknown_abstained": rate(23, 24),
        "unknown_wrong": rate(1, 24),
        "set_f1": {"value": 0.92, "n": 30},
        "closure_median": 0.95,
        "closure_tenth": 0.83,
        "residual_over_floor_median": 1.1,
        "interval_coverage": rate(110, 120),
        "simulations_median": 60,
        "simulations_most": 95,
        "bank_most": 2400,
        "seconds_median": 12.0,
        "seconds_total": 900.0,
        "by_units": units,
        "by_effect": [{"effect": "viscous", "n": 8, **outcomes(8, right=7, wrong=1)}],
        "by_kind": [{"kind": "no_effort", "n": 12, **outcomes(12, right=4, covered=6, abstained=1, missed=1)}],
        "confusion": [
            {"hidden": "viscous", "answer": "viscous", "cases": 7},
            {"hidden": "viscous", "answer": "gain_d", "cases": 1},
            {"hidden": "coulomb", "answer": "coulomb elsewhere", "cases": 2},
            {"hidden": "coulomb", "answer": "one of coulomb | backlash", "cases": 3},
            {"hidden": "cubic_spring", "answer": "none_of_the_known", "cases": 22},
            {"hidden": "payload + viscous", "answer": "payload + viscous", "cases": 4},
            {"hidden": "nothing", "answer": "no_discrepancy", "cases": 159},
            {"hidden": "nothing", "answer": "lag", "cases": 1},
        ],
        "calibration": [
            {"said_low": 0.9, "said_high": 1.0, "said_mean": 0.97, "right": rate(60, 63)},
            {"said_low": 0.4, "said_high": 0.6, "said_mean": 0.5, "right": rate(5, 9)},
            {"said_low": 0.0, "said_high": 0.1, "said_mean": 0.05, "right": rate(0, 0)},
        ],
        "brier": 0.03,
        "list": [
            *({**right_case, **common, "key": f"t2-{k}", **of} for k in range(20)),
            {**wrong_case, **common, "sureness": {"gain": 0.7}, "guessed_right": False},
            {**right_case, **common, **of},
        ],
    }


def tier_scores(tier: str, split: str = "scored", **ours: int) -> dict:
    """Of one tier: ours and a poorer way."""
    methods = {"gsbridge": method_scores(**ours), "cosine": method_scores(24, 12, 30)}
    return {"tier": tier, "split": split, "cases": 320, "methods": methods}
