"""The block of README that quotes recorded figures: only those of fresh areas, and every floor that they miss."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.report.scores.results_page import AREAS, freshness, read_record, shown, shown_floor, shown_interval

HEADLINES = (
    *("make_tables_wall", "make_toy_wall", "camera_error_median", "scale_error_median", "mask_iou_median"),
    *("chamfer_visual_median", "soft_minus_games_all_mean", "soft_minus_games_vertices_all_mean"),
    *("soft_psnr_objects_min", "eye_in_hand_gs_min"),
    *(
        "eye_in_hand_lead_unshaded_min",
        "grasp_sim_fixed",
        "grasp_mirror_fixed",
        "place_mirror_fixed",
        "drop_eight_mirror_fixed",
    ),
    *("severity_grasp_2", "severity_grasp_3", "severity_place_2", "severity_mesh_2", "severity_grasp_outside_2"),
    *("rl_sim_drop_mirror_fixed", "study_lead_min", "gap_named_right_t2", "gap_wrong_t2", "gap_false_alarm"),
    *("gap_named_right_t5", "gap_wrong_t5", "gap_tosses_closed", "gap_so101_median", "gap_so101_worst"),
)
"""Figures that README quotes where they are fresh, in its order."""

BEGIN, END = "<!-- figures: `make results-page` writes this block -->", "<!-- end of figures -->"

Records = Mapping[str, Mapping[str, Mapping[str, Any]]]


def readme_block(records: Records, now: Mapping[str, Mapping[str, Mapping[str, str]]]) -> str:
    """Make the text of the block, without its marks.

    Args:
        records: {area: {`provenance`, `figures`}}, empty for an area that was never recorded.
        now: Digests of the current tree, {area: {code, settings, models}}.
    """
    fresh = [area for area, record in records.items() if record and freshness(area, record["provenance"], now[area]) == "fresh"]
    known = {name: (area, score) for area in fresh for name, score in records[area]["figures"].items()}
    quoted = [known[name] for name in HEADLINES if known.get(name, ("", {}))[1].get("value") is not None]
    lines = [*_table(quoted), ""] if quoted else []
    floors = [(area, score) for area, score in known.values() if score.get("floor") is not None]
    missed = [(area, score) for area, score in floors if not score["met"] and score["value"] is not None]
    unmeasured = [(area, score) for area, score in floors if score["value"] is None]
    if missed:
        lines += [
            f"Missed floors, {len(missed)} of the {len(floors)} in the areas that are measured on this tree:",
            "",
            *_table(missed),
            "",
        ]
    if unmeasured:
        lines += [f"Floors that nothing was measured against, {len(unmeasured)} of the {len(floors)}:", ""]
        lines += [*(f"* {score['what']}: {shown_floor(score)} ({area})" for area, score in unmeasured), ""]
    stale = [area for area, record in records.items() if record and area not in fresh]
    never = [area for area, record in records.items() if not record]
    if not fresh:
        lines.append("No figure is quoted here, since every area is stale or was not measured yet.")
    if stale:
        lines.append(
            f"Measured on an earlier tree: {', '.join(stale)}. [RESULTS.md](benchmarks/RESULTS.md) has their figures, and says "
            "what has changed since."
        )
    if never:
        lines.append(f"Not measured yet: {', '.join(never)}.")
    return "\n".join(lines).strip()


def _table(rows: Sequence[tuple[str, Mapping[str, Any]]]) -> list[str]:
    """Figures as a table, with the intervals that some have."""
    lines = ["| figure | measured | interval | floor | area |", "|---|---|---|---|---|"]
    for area, score in rows:
        value, floor = shown(score["value"], score["unit"]), shown_floor(score) or "reported"
        lines.append(f"| {score['what']} | {value} | {shown_interval(score)} | {floor} | {area} |")
    return lines


def with_block(text: str, block: str) -> str:
    """Replace the block of a page.

    Args:
        text: The page, which holds `BEGIN` and `END` once.
        block: New text between the marks.

    Raises:
        ValueError: The page does not hold each mark exactly once.
    """
    pattern = re.compile(f"{re.escape(BEGIN)}.*?{re.escape(END)}", re.DOTALL)
    if len(pattern.findall(text)) != 1:
        raise ValueError(f"the page does not hold {BEGIN} and {END} once")
    return pattern.sub(lambda _: f"{BEGIN}\n\n{block}\n\n{END}", text)


def write_readme_block(
    readme: str | Path, folder: str | Path, now: Mapping[str, Mapping[str, Mapping[str, str]]], *, check: bool = False
) -> bool:
    """Write the block into README, unless it is up to date.

    Args:
        readme: The page.
        folder: Recorded scores, `{area}.json`.
        now: Digests of the current tree, {area: {code, settings, models}}.
        check: Compare only, and write nothing.

    Returns:
        Whether the block was up to date.

    Raises:
        InputError: A record is damaged, or the page lacks the marks of the block.
    """
    records = {area: read_record(Path(folder) / f"{area}.json") for area in AREAS}
    text = Path(readme).read_text(encoding="utf-8")
    try:
        wanted = with_block(text, readme_block(records, now))
    except ValueError as error:
        raise InputError(readme, str(error), f"Put {BEGIN} and {END} where the figures belong") from error
    if wanted != text and not check:
        with atomic_file(readme) as temporary:
            temporary.write_text(wanted, encoding="utf-8")
    return wanted == text
