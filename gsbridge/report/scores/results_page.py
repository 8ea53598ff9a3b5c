"""`benchmarks/RESULTS.md`: every figure of `benchmarks/scores`, its floor, and where the number comes from."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.experiment.provenance import NOMINAL, matters
from gsbridge.experiment.seals import read_seals
from gsbridge.files import atomic_file, read_json
from gsbridge.statistics import wilson_interval

AREAS = (
    "real2sim",
    "shapes",
    "photos",
    "simulator",
    "policies",
    "worlds",
    "severity",
    "worth",
    "study",
    "gap",
    "gap_rivals",
    "gap_bodies",
    "gap_pictures",
    "gap_real",
    "loops",
)
"""Areas of the figures, in the page's order."""

NAMED = 6
"""Largest number of changes that the page names."""

COUNT = re.compile(r"(\d+) of (\d+)")
"""Form of a seal's figure that is a count, such as `12 of 40`: only counts can be added up over seals."""

SIGNS = {"at_least": "≥", "at_most": "≤"}


def shown(value: float | None, unit: str = "") -> str:
    """Format a number with four significant digits and its unit; None becomes a dash."""
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


def shown_interval(score: Mapping[str, Any]) -> str:
    """Both ends of a figure's interval; a dash where it has none.

    A mean of two shows both values instead: Student's interval of two is wider than anything possible, and one that counts
    trials hides how far they are apart.
    """
    interval, each = score.get("interval"), score.get("by_scene") or {}
    if len(each) == 2 and "Student" in str(score.get("interval_of")):
        return f"{' and '.join(shown(value + 0.0) for value in each.values())} (both)"
    return f"{shown(interval[0])} … {shown(interval[1])}" if interval else "–"


def verdict(score: Mapping[str, Any]) -> str:
    """Judge a score: `met`, `stretch met`, `stretch not met`, `reported` without any aim, or `unmet` with the reason."""
    if not score["met"]:
        return f"**unmet**: {score['reason']}"
    if score["floor"] is None and score.get("stretch") is None:
        return "reported"
    if score["stretch_met"]:
        return "stretch met"
    return "met" if score["floor"] is not None else "stretch not met"


def changes(area: str, recorded: Mapping[str, Mapping[str, str]], now: Mapping[str, Mapping[str, str]]) -> list[str]:
    """List what has changed since an area was recorded: names of rules and settings whose digests differ now.

    Args:
        area: The area; settings that cannot change its figures do not count, though a record may hold them.
        recorded: {`code`: {rule: digest}, `settings`: {setting: digest}, `models`: {path: digest}} beside the recorded figures.
        now: Digests of the tree as it is now, in the same layout; without `models` where the area reads none.

    Returns:
        Rules first, then settings, then model files. Added and removed rules count as changed, and so does the nominal model in
        a record of the time before model files were recorded; of the other settings and files, only recorded ones are compared.
    """
    code, new = recorded["code"], now["code"]
    rules = [name for name in {**code, **new} if code.get(name) != new.get(name)]
    counting = {name: digest for name, digest in recorded["settings"].items() if matters(area, name)}
    settings = [name for name, digest in counting.items() if now["settings"].get(name) != digest]
    models, found = recorded.get("models", {}), now.get("models", {})
    compared = dict.fromkeys([*(name for name in found if name == NOMINAL), *models])
    return rules + settings + [name for name in compared if models.get(name) != found.get(name)]


def freshness(area: str, recorded: Mapping[str, Any], now: Mapping[str, Mapping[str, str]]) -> str:
    """State whether the current tree would make an area's figures: `fresh`, or `stale` with what has changed since.

    Args:
        area: The area.
        recorded: {`commit`, `code`, `settings`, `models`} beside the recorded figures.
        now: Digests of the tree as it is now; see `changes`.
    """
    if not recorded.get("code"):
        return "**stale**: recorded before digests stood beside figures"
    found = changes(area, recorded, now)
    if not found:
        return "fresh"
    named = ", ".join(f"`{name}`" for name in found[:NAMED])
    more = f" and {len(found) - NAMED} more" if len(found) > NAMED else ""
    return f"**stale** since {named}{more} changed"


def results_markdown(
    records: Mapping[str, Mapping[str, Mapping[str, Any]]], now: Mapping[str, Mapping[str, Mapping[str, str]]]
) -> str:
    """Make the text of the page.

    Args:
        records: {area: {`provenance`: {commit, code, settings, models}, `figures`: {figure: score}}}; empty for an area that
            was never recorded.
        now: Digests of the current tree, {area: {code, settings, models}}.
    """
    lines = [
        "# Results",
        "",
        "Generated from `benchmarks/scores/*.json` by the rule `write_results_page`; do not edit by hand. Floors are listed in",
        "`benchmarks/floors.yaml`; `benchmarks/FLOORS.md` tells since when each stands and what was measured when it was first",
        "missed. A figure that was not measured, or was measured on less than the floor asks for, is unmet.",
        "An area is *fresh* where the code of the rules behind it and the settings are those of the measurement; figures of a",
        "*stale* area tell about an earlier state of the project.",
        "",
        "| area | floors met | measured at | state |",
        "|---|---|---|---|",
    ]
    for area, record in records.items():
        floors = _floors(record)
        met = f"{sum(score['met'] for score in floors)} of {len(floors)}"
        told = record.get("provenance", {})
        state = freshness(area, told, now[area]) if record else "not recorded yet"
        lines.append(f"| [{area}](#{area}) | {met if record else '–'} | {told.get('commit', '–')} | {state} |")
    for area, record in records.items():
        if not record:
            lines += ["", f"## {area}", "", "Not recorded yet."]
            continue
        figures = record["figures"]
        lines += ["", f"## {area}", ""]
        lines += ["| figure | floor | measured | interval | n | | from |", "|---|---|---|---|---|---|---|"]
        for name, score in figures.items():
            counts = f"{score['n']}" + (f" × {score['seeds']} seeds" if score.get("seeds") else "")
            lines.append(
                f"| {score['what']} (`{name}`) | {shown_floor(score)} | {shown(score['value'], score['unit'])} "
                f"| {shown_interval(score)} | {counts} | {verdict(score)} | `{score['where']}` |"
            )
        lines += _by_scene(figures)
    return "\n".join(lines) + "\n"


def seals_markdown(seals: Sequence[Mapping[str, Any]]) -> str:
    """List every seal of the gap's benchmark that was ever scored, with its first score; empty text where there is none."""
    if not seals:
        return ""
    lines = ["", "## Seals of the gap's benchmark", ""]
    lines += [
        "Numbers that drew a scored split of their own (`GSBRIDGE_SEAL`), each with its first score and its code's digest."
    ]
    lines += ["", "| seal | part | code | cases | figures |", "|---|---|---|---|---|"]
    for item in seals:
        for part, told in item["parts"].items():
            figures = ", ".join(f"{name} {text}" for name, text in told["figures"].items())
            note = f" **{told['note']}**" if "note" in told else ""
            lines.append(f"| {item['seal']} | {part} | `{told['code']}` | {told['cases']} | {figures}{note} |")
    return "\n".join(lines + _all_seals(seals)) + "\n"


def laboratories_markdown(laboratories: Sequence[Mapping[str, Any]]) -> str:
    """List the seeds of the laboratories of severity and what was seen of each; empty text where there is none."""
    if not laboratories:
        return ""
    lines = ["", "## Laboratories of severity", ""]
    lines += ["Seeds of the worlds `lab_0` to `lab_4`, the present one last. One that was looked at is development data."]
    lines += ["", "| seed | what was seen of it |", "|---|---|"]
    return "\n".join([*lines, *(f"| {item['seed']} | {item['seen'] or 'nothing'} |" for item in laboratories)]) + "\n"


def _all_seals(seals: Sequence[Mapping[str, Any]]) -> list[str]:
    """Make the lines of the table that adds up counts over the seals, by part; empty where no part was scored twice."""
    counts: dict[str, dict[str, list[tuple[int, int]]]] = {}
    scored: dict[str, int] = {}
    for item in seals:
        for name, told in item["parts"].items():
            # Cases from another state of the benchmark (`apart`) ask other questions, so their counts are added up apart.
            part = f"{name}, {told['apart']}" if "apart" in told else name
            scored[part] = scored.get(part, 0) + 1
            for figure, text in told["figures"].items():
                if count := COUNT.fullmatch(str(text)):
                    counts.setdefault(part, {}).setdefault(figure, []).append((int(count[1]), int(count[2])))
    if max(scored.values(), default=0) < 2:
        return []
    names = list(dict.fromkeys(name for found in counts.values() for name in found))
    lines = ["", "All first scores together, whatever the code of the diagnosis was. Brackets are Wilson's 95 % intervals.", ""]
    lines += ["| part | seals | " + " | ".join(names) + " |", "|---" * (len(names) + 2) + "|"]
    for part in sorted(counts):
        cells = " | ".join(_added_up(counts[part].get(name, [])) for name in names)
        lines.append(f"| {part} | {scored[part]} | {cells} |")
    return lines


def _added_up(counts: Sequence[tuple[int, int]]) -> str:
    """Add up counts `a of n`, with the interval of the rate in percent; a dash where nothing was counted."""
    good, tried = (sum(column) for column in zip(*counts, strict=True)) if counts else (0, 0)
    if not tried:
        return "–"
    low, high = wilson_interval(good, tried)
    return f"{good} of {tried} ({100 * low:.0f} to {100 * high:.0f})"


def _floors(record: Mapping[str, Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Figures of an area that have a floor."""
    return [score for score in record.get("figures", {}).values() if score["floor"] is not None]


def _by_scene(figures: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Make the lines of the table of figures by scene; empty where no figure has values by scene."""
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


def read_record(path: str | Path) -> dict[str, dict[str, Any]]:
    """Read the recorded figures of an area, {`provenance`, `figures`}; empty where there is no file.

    Raises:
        InputError: The file is damaged.
    """
    if not Path(path).exists():
        return {}
    record = read_json(path)
    if not {"provenance", "figures"} <= set(record):
        raise InputError(path, "the file holds no recorded figures", "Delete it and run `make results`")
    return record


def write_results_page(folder: str | Path, out: str | Path, now: Mapping[str, Mapping[str, Mapping[str, str]]]) -> None:
    """Write `benchmarks/RESULTS.md`.

    Args:
        folder: Recorded scores, `{area}.json`; areas without one are said to be missing.
        out: The page.
        now: Digests of the current tree, {area: {code, settings, models}}, as `gsbridge.experiment.provenance` gives them.

    Raises:
        InputError: A file is damaged.
    """
    text = results_markdown({area: read_record(Path(folder) / f"{area}.json") for area in AREAS}, now)
    laboratories = Path(folder).parent / "laboratories.json"
    text += laboratories_markdown(read_json(laboratories)["laboratories"] if laboratories.exists() else [])
    text += seals_markdown(read_seals(Path(folder).parent / "seals"))
    with atomic_file(out) as temporary:
        temporary.write_text(text, encoding="utf-8")
