"""The page of the blind benchmark: what was named right, wrong or left open, against floors and simpler methods."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.experiment.gap_benchmark import AREAS
from gsbridge.report.gap.benchmark_figures import (
    METHODS,
    confusion_width,
    draw_calibration,
    draw_confusion,
    draw_curves,
    draw_methods,
    draw_sizes,
    effect_title,
    tier_title,
)
from gsbridge.report.pages.html import write_page
from gsbridge.report.scores.measured_gap import ARMS, OURS, PHOTOS, gap_figures, logged_figures, pooled, read_tiers
from gsbridge.report.scores.results_page import shown, shown_floor, verdict
from gsbridge.report.scores.score import ANY_PRESET, read_floors, score_figure

SHOWN = ("right", "covered", "abstained", "missed", "wrong", "quiet", "false_alarm")
"""Outcomes in the columns of the tables by effect and by kind of case."""


def write_gap_benchmark(
    scores: Sequence[str | Path],
    floors: str | Path,
    preset: str,
    out: str | Path,
    *,
    real: str | Path | None = None,
    arm: str | Path | None = None,
) -> None:
    """Write the page.

    Args:
        scores: `scores.json` of each tier.
        floors: `benchmarks/floors.yaml`.
        preset: Preset that the tiers ran with.
        out: The HTML file.
        real: File for `real_figures` on real logs; None where the logs are not on this machine.
        arm: File for `arm_figures` on a real arm's motions; None likewise.

    Raises:
        InputError: A file is missing or damaged.
    """
    tiers = read_tiers(scores)
    measured = gap_figures(tiers) | logged_figures(real, arm)
    ours = {tier: found["methods"][OURS] for tier, found in tiers.items()}
    splits = sorted({found["split"] for found in tiers.values()})
    write_page(
        out,
        "benchmark.html.j2",
        headline=headline(ours),
        splits=splits,
        preset=preset,
        floors=_floors(measured, floors, preset),
        sizes=draw_sizes(ours),
        tiers=[_tier(tier, found) for tier, found in tiers.items()],
        curves=_curves(tiers),
        calibration=draw_calibration(ours),
        brier=", ".join(f"{tier_title(tier)} {shown(found['brier'])}" for tier, found in ours.items()),
        wrong=_wrong(ours),
    )


def headline(ours: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """State the result in a few sentences; photos have a sentence of their own, because their units are far smaller."""
    moving = [scores for tier, scores in ours.items() if tier != PHOTOS]
    right, wrong = (pooled([scores[key] for scores in moving]) for key in ("named_right", "named_wrong"))
    alarms, strange = (pooled([scores[key] for scores in ours.values()]) for key in ("false_alarm", "unknown_abstained"))
    out = []
    if right["n"]:
        out.append(
            f"Of {right['n']} hidden effects of at least five times the detection limit, {_share(right)} were named right; "
            f"of {wrong['n']} of any size, {_share(wrong)} got a wrong name."
        )
    if PHOTOS in ours and ours[PHOTOS]["named_right"]["n"]:
        seen, mistaken = (ours[PHOTOS][key] for key in ("named_right", "named_wrong"))
        out.append(
            f"In photos, {_share(seen)} of {seen['n']} were named right, and {_share(mistaken)} of {mistaken['n']} wrong."
        )
    if alarms["n"]:
        out.append(f"Where nothing was hidden, {_share(alarms)} of {alarms['n']} cases raised an alarm.")
    if strange["n"]:
        out.append(f"Effects that no catalogue holds: {_share(strange)} of {strange['n']} recognised as such.")
    return out


def _share(rate: Mapping[str, Any]) -> str:
    """Format a rate with its interval, percent; a dash where there is no rate."""
    if rate["value"] is None:
        return "–"
    return f"{100 * rate['value']:.1f} % ({100 * rate['ci95_low']:.1f} to {100 * rate['ci95_high']:.1f})"


def _floors(measured: Mapping[str, Mapping[str, Any]], floors: str | Path, preset: str) -> dict[str, list[Any]]:
    """Collect the floors of `AREAS`: rows for figures that were measured, titles of those that were not."""
    rows: list[dict[str, str]] = []
    missing: list[str] = []
    for name, entry in read_floors(floors).items():
        if entry["area"] not in AREAS:
            continue
        score = score_figure(entry, measured.get(name), preset)
        if score["value"] is None:
            missing.append(score["what"])
            continue
        interval = score["interval"]
        # A floor that is asked of another preset is not judged by this run.
        judged = entry["preset"] in (ANY_PRESET, preset)
        word = "met" if score["met"] else "unmet" if judged else "not judged"
        rows.append(
            {
                "what": score["what"],
                "floor": shown_floor(score),
                "value": shown(score["value"], score["unit"]),
                "interval": f"{shown(interval[0])} to {shown(interval[1])}" if interval else "–",
                "n": str(score["n"]),
                "met": word if score["floor"] is not None else "reported",
                "why": "" if score["met"] else verdict(score).removeprefix("**unmet**: "),
            }
        )
    return {"rows": rows, "missing": missing}


def _tier(tier: str, found: Mapping[str, Any]) -> dict[str, Any]:
    """Collect what the page shows about one tier: methods, confusion, effects, kinds."""
    methods, ours = found["methods"], found["methods"][OURS]
    return {
        "id": tier,
        "title": tier_title(tier),
        "cases": found["cases"],
        "methods": [
            {
                "name": METHODS.get(name, name),
                "right": _share(scores["named_right"]),
                "wrong": _share(scores["named_wrong"]),
                "alarm": _share(scores["false_alarm"]),
                "unknown": _share(scores["unknown_abstained"]),
                "f1": shown(scores["set_f1"]["value"]),
                "closure": shown(scores["closure_median"]),
                "simulations": shown(scores["simulations_median"]),
                "seconds": shown(scores["seconds_median"]),
            }
            for name, scores in methods.items()
        ],
        "race": draw_methods(tier, methods) if len(methods) > 1 else None,
        "confusion": draw_confusion(ours["confusion"], tier),
        "confusion_rem": confusion_width(ours["confusion"], tier),
        "effects": _counts(ours["by_effect"], "effect", lambda name: _effect_title(name, tier)),
        "kinds": _counts(ours["by_kind"], "kind"),
        "left_out": ", ".join(title for name, title in METHODS.items() if name not in methods),
    }


def _curves(tiers: Mapping[str, Mapping[str, Any]]) -> dict[str, str] | None:
    """Draw risk against coverage of the methods that ran in every tier of arms; without arms, in every tier with several.

    Returns:
        `picture` and the titles of its `tiers`; None for fewer than two methods.
    """
    chosen = [tier for tier in ARMS if tier in tiers] or [tier for tier in tiers if len(tiers[tier]["methods"]) > 1]
    found = [tiers[tier]["methods"] for tier in chosen]
    names = [name for name in found[0] if all(name in methods for methods in found)] if found else []
    if len(names) < 2:
        return None
    lists = {name: [row for methods in found for row in methods[name]["list"]] for name in names}
    return {"picture": draw_curves(lists), "tiers": "; ".join(tier_title(tier) for tier in chosen)}


def _plain(name: str) -> str:
    """A name with spaces instead of underscores."""
    return name.replace("_", " ")


def _effect_title(name: str, tier: str) -> str:
    """Title of an effect with the name that files use in brackets; the name alone where no catalogue has it."""
    title = effect_title(name, tier)
    return f"{title} ({_plain(name)})" if title != _plain(name) else title


def _counts(rows: Sequence[Mapping[str, Any]], group: str, title: Callable[[str], str] = _plain) -> list[dict[str, Any]]:
    """Turn each group's rates back into numbers of cases by outcome."""
    return [
        {
            "title": title(str(row[group])),
            "n": str(row["n"]),
            "outcomes": [str(round((row[name]["value"] or 0.0) * row[name]["n"])) for name in SHOWN],
        }
        for row in rows
    ]


def _wrong(ours: Mapping[str, Mapping[str, Any]]) -> list[dict[str, str]]:
    """List every case to which this package gave a wrong name or a false alarm."""
    return [
        {
            "tier": tier_title(tier),
            "key": case["key"],
            "kind": case["kind"],
            "hidden": case["hidden"] or "nothing",
            "units": shown(case["units"]),
            "answer": case["answer"],
        }
        for tier, scores in ours.items()
        for case in scores["list"]
        if case["outcome"] in ("wrong", "false_alarm")
    ]
