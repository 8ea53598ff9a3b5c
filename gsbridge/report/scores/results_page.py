"""`benchmarks/RESULTS.md`: every figure of `benchmarks/scores`, its floor, and where the number comes from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsbridge.files import atomic_file, read_json

AREAS = ("real2sim", "simulator", "policies", "worlds", "study", "gap", "loops")
"""In the page's order."""

SIGNS = {"at_least": "≥", "at_most": "≤"}


def shown(value: float | None, unit: str = "") -> str:
    """A number for people: four significant digits, its unit behind it, a dash for none."""
    if value is None:
        return "–"
    text = f"{value:.4g}" if not isinstance(value, bool) else str(value)
    return f"{text} {unit}".strip()


def shown_floor(score: Mapping[str, Any]) -> str:
    """Floor with its direction, and the stretch aim where there is one."""
    sign = SIGNS[score["direction"]]
    parts = [] if score["floor"] is None else [f"{sign} {shown(score['floor'], score['unit'])}"]
    if score.get("stretch") is not None:
        parts.append(f"(stretch {sign} {shown(score['stretch'], score['unit'])})")
    return " ".join(parts)


def verdict(score: Mapping[str, Any]) -> str:
    """`met`, `stretch met`, `reported` where nothing is asked for, or `unmet` with the reason."""
    if not score["met"]:
        return f"**unmet**: {score['reason']}"
    if score["floor"] is None and score.get("stretch") is None:
        return "reported"
    if score["stretch_met"]:
        return "stretch met"
    return "met" if score["floor"] is not None else "stretch not met"


def results_markdown(scores: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """The page.

    Args:
        scores: {area: {figure: score}}.
    """
    lines = [
        "# Results",
        "",
        "Generated from `benchmarks/scores/*.json` by the rule `write_results_page`; do not edit by hand. Floors are listed in",
        "`benchmarks/floors.yaml`. A figure that was not measured, or was measured on less than the floor asks for, is unmet.",
    ]
    for area, figures in scores.items():
        if not figures:
            lines += ["", f"## {area}", "", "Not recorded yet."]
            continue
        floors = [score for score in figures.values() if score["floor"] is not None]
        met = sum(score["met"] for score in floors)
        commits = sorted({score["commit"] for score in figures.values()})
        lines += ["", f"## {area}", "", f"{met} of {len(floors)} floors met; measured at {', '.join(commits)}.", ""]
        lines += ["| figure | floor | measured | interval | n | | from |", "|---|---|---|---|---|---|---|"]
        for name, score in figures.items():
            interval = score.get("interval")
            span = f"{shown(interval[0])} … {shown(interval[1])}" if interval else "–"
            counts = f"{score['n']}" + (f" × {score['seeds']} seeds" if score.get("seeds") else "")
            lines.append(
                f"| {score['what']} (`{name}`) | {shown_floor(score)} | {shown(score['value'], score['unit'])} | {span} "
                f"| {counts} | {verdict(score)} | `{score['where']}` |"
            )
        lines += _by_scene(figures)
    return "\n".join(lines) + "\n"


def _by_scene(figures: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Lines of the table that opens the figures up by scene."""
    open_figures = {name: score["by_scene"] for name, score in figures.items() if score.get("by_scene")}
    scenes = list(dict.fromkeys(scene for values in open_figures.values() for scene in values))
    if not scenes:
        return []
    lines = ["", "### By scene", "", "| figure | " + " | ".join(scenes) + " |", "|---" * (len(scenes) + 1) + "|"]
    seen: list[Mapping[str, float]] = []
    for name, values in open_figures.items():
        # Several floors look at the same values (a median and a worst case): one line is enough.
        if values not in seen:
            seen.append(values)
            cells = " | ".join(shown(values.get(scene)) for scene in scenes)
            lines.append(f"| `{name}` ({figures[name]['unit'] or '1'}) | {cells} |")
        for title, others in (figures[name].get("beside") or {}).items():
            cells = " | ".join(shown(others.get(scene)) for scene in scenes)
            lines.append(f"| {title} ({figures[name]['unit'] or '1'}) | {cells} |")
    return lines


def write_results_page(folder: str | Path, out: str | Path) -> None:
    """Write `benchmarks/RESULTS.md`.

    Args:
        folder: Recorded scores, `{area}.json`; areas without one are said to be missing.
        out: The page.

    Raises:
        InputError: A file is damaged.
    """
    files = [Path(folder) / f"{area}.json" for area in AREAS]
    text = results_markdown({path.stem: read_json(path) if path.exists() else {} for path in files})
    with atomic_file(out) as temporary:
        temporary.write_text(text, encoding="utf-8")
