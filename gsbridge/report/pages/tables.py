"""Assembling rows and figures into `results/tables`: CSV, Markdown, LaTeX, and one HTML page."""

from __future__ import annotations

import base64
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

from gsbridge.errors import InputError
from gsbridge.files import atomic_directory
from gsbridge.images import read_image_u8
from gsbridge.report.pages.html import render
from gsbridge.report.pages.policies import (
    Picture,
    degraded_policies,
    film,
    policy_headline,
    policy_parts,
    policy_tables,
    read_policy_rows,
)
from gsbridge.report.tables import rendering_rows as rendering_table
from gsbridge.report.tables import timing as timing_table
from gsbridge.report.tables.formats import Table, latex, markdown
from gsbridge.report.tables.rendering import SceneLine, decibel, mean_gain, rendering_tables, scene_lines
from gsbridge.report.tables.result_paths import scene_of
from gsbridge.report.tables.rows import Row, number, read_rows
from gsbridge.report.tables.stages import degraded_reasons, read_records, stages_table

EMBEDDED_JPEG_QUALITY = 90

CAPTIONS = {
    "rendering_comparison": (
        "Photos beside renderings of the splats and their differences",
        "Photos that no training saw, what the splats of each binding show from the same place, and five times the absolute "
        "difference to the photo. The second line of each scene is the framed part, enlarged. Good looks like a sharp texture "
        "and a dark difference without a bright rim.",
    ),
    "success_rates": (
        "Success rate of each cell in simulation and in the other world",
        "Success of each cell with its 95 % interval, in simulation and in the other world. Hollow marks: the paper's, "
        "simulation and its robot. Good looks like both worlds at the right edge, one below the other.",
    ),
    "learning_curves": (
        "Success during training against environment steps",
        "Success in the evaluations of each training, from random start poses in simulation that are neither the fixed nor the "
        "unseen ones, against environment steps. The dashed line is the baseline controller's success from the same poses.",
    ),
    "behaviour_consistency": (
        "Paths of the hand and pictures of the wrist camera in both worlds",
        "The same policy from the same start pose in simulation and in the mirror: paths of the hand and what the wrist camera "
        "sees on the way. Good looks like paths that lie on one another.",
    ),
}
"""Title and caption by the beginning of a figure's name."""


@dataclass(frozen=True)
class StageTime:
    """Time of all jobs of one rule: seconds, peak memory of the largest job in MB, share of the longest rule in percent."""

    rule: str
    jobs: int
    wall_s: float
    cpu_s: float
    max_rss_mb: float
    share: float
    slowest: str


def stage_times(rows: Sequence[Row]) -> list[StageTime]:
    """Sum the times over the jobs of each rule, the longest rule first."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row["rule"], []).append(row)
    walls = {rule: sum(number(row["wall_s"]) or 0.0 for row in found) for rule, found in groups.items()}
    longest = max(walls.values(), default=0.0) or 1.0
    out = []
    for rule, found in groups.items():
        slowest = max(found, key=lambda row: number(row["wall_s"]) or 0.0)
        cpu = sum(number(row["cpu_s"]) or 0.0 for row in found)
        memory = max(number(row["max_rss_mb"]) or 0.0 for row in found)
        out.append(StageTime(rule, len(found), walls[rule], cpu, memory, 100 * walls[rule] / longest, slowest["item"]))
    return sorted(out, key=lambda stage: (-stage.wall_s, stage.rule))


def timing_display(rows: Sequence[Row]) -> Table:
    """Lay out the time per rule for print."""
    body = [
        (s.rule, str(s.jobs), f"{s.wall_s:.1f}", f"{s.cpu_s:.1f}", f"{s.max_rss_mb:.0f}", s.slowest or "–")
        for s in stage_times(rows)
    ]
    columns = ("rule", "jobs", "wall s", "CPU s", "peak MB", "slowest item")
    return Table("Time per stage, summed over its jobs", columns, tuple(body))


def plain_table(name: str, rows: Sequence[Row]) -> Table:
    """Lay out the rows of a table that has no layout of its own, as they are."""
    columns = tuple(rows[0]) if rows else ("empty",)
    return Table(name.replace("_", " "), columns, tuple(tuple(row[column] for column in columns) for row in rows))


def picture(path: str | Path) -> Picture:
    """Encode a figure as a data URI, photos as JPEG, so that the page is one file that can be mailed.

    Raises:
        InputError: The figure is missing, is no image, or has no caption in `CAPTIONS`.
    """
    source = Path(path)
    words = next((words for name, words in CAPTIONS.items() if source.stem.startswith(name)), None)
    if words is None:
        raise InputError(source, "the page has no caption for this figure", f"Name one of {', '.join(CAPTIONS)}")
    if source.suffix.lower() == ".svg":
        if not source.is_file():
            raise InputError(source, "the figure does not exist", "Run the rule that draws it")
        data, kind = source.read_bytes(), "image/svg+xml"
    else:
        image = read_image_u8(source)[..., ::-1]
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, EMBEDDED_JPEG_QUALITY])[1].tobytes()
        kind = "image/jpeg"
    return Picture(source.stem, *words, f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}")


def headline(lines: Sequence[SceneLine]) -> list[str]:
    """Summarise the rendering table in a sentence for each kind of scene."""
    out = []
    for kind, name in (("object", "objects"), ("background", "backgrounds")):
        mine = [line for line in lines if line.kind == kind and line.origin == "mirror" and line.gain is not None]
        mean = mean_gain(mine)
        if mean is None:
            continue
        paper = [line.paper_gain for line in mine if line.paper_gain is not None]
        beside = f" (the paper, on its own captures: {decibel(sum(paper) / len(paper), signed=True)} dB)" if paper else ""
        word = name if len(mine) > 1 else kind
        out.append(
            f"On {len(mine)} mirrored {word}, soft binding shows held-out photos {decibel(abs(mean))} dB "
            f"{'better' if mean >= 0 else 'worse'} than GaMeS{beside}."
        )
    return out


def write_tables(
    rows: Sequence[str | Path],
    figures: Sequence[str | Path],
    out_dir: str | Path,
    *,
    preset: str = "",
    records: Sequence[str | Path] = (),
    policy_figures: Sequence[str | Path] = (),
    films: Sequence[tuple[str, str | Path]] = (),
    scene_pages: Sequence[str | Path] = (),
) -> None:
    """Write the folder of tables.

    Args:
        rows: CSV files of rows; `rendering.csv`, `timing.csv` and those about policies (`NAMES` in `policies`) get their
            own layout, others are shown as they are.
        figures: Pictures for the page; names that end in `_real` stand with the real captures.
        out_dir: Folder, replaced whole: each rows file, `{name}.md` and `{name}.tex` for each, and `index.html`.
        preset: Name of the preset, for the page.
        records: Stage records, for the table of stages and the list of degraded results; without them the list holds
            the rows' own reasons.
        policy_figures: Pictures for the page's part about policies, in their order.
        films: Title and file of films of trials; they become part of the page.
        scene_pages: Pages of single scenes, `scenes/{scene}/report.html`, which the page links to.

    Raises:
        InputError: Rows, a figure or a film cannot be read.
    """
    named = {Path(path).stem: Path(path) for path in rows}
    policies = read_policy_rows(named)
    rendering = read_rows(named["rendering"], rendering_table.COLUMNS) if "rendering" in named else []
    timing = read_rows(named["timing"], timing_table.COLUMNS) if "timing" in named else []
    known = read_records(records)
    scenes = degraded_reasons(known) if records else _degraded(rendering)
    degraded = {**scenes, **degraded_policies(policies, scenes)}
    # A scene counts as degraded if any of its stages is, whatever the record of its splats says.
    by_origin = rendering_tables([{**row, "status": "degraded"} if row["scene"] in scenes else row for row in rendering])
    printed: dict[str, list[Table]] = policy_tables(policies)
    others: list[Table] = []
    for name, path in named.items():
        if name == "rendering":
            printed[name] = by_origin["mirror"] + [_retitled(table, "Real captures: ") for table in by_origin["real"]]
        elif name == "timing":
            printed[name] = [timing_display(timing)]
        elif name not in policies:
            others.append(plain_table(name, read_rows(path)))
            printed[name] = [others[-1]]
    page = render(
        "tables.html.j2",
        preset=preset,
        headline=headline(scene_lines(rendering, split="held_out", region="masked")),
        mirror=by_origin["mirror"],
        real=by_origin["real"],
        stages=stages_table(known),
        scene_pages={scene_of(path): os.path.relpath(path, out_dir) for path in scene_pages},
        degraded=degraded,
        times=stage_times(timing),
        others=others,
        pictures=[picture(path) for path in figures],
        parts=policy_parts(printed, [picture(path) for path in policy_figures]),
        policy_headline=policy_headline(policies),
        films=[film(title, path) for title, path in films],
    )
    with atomic_directory(out_dir) as folder:
        for name, path in named.items():
            shutil.copyfile(path, folder / f"{name}.csv")
            text = "\n".join(markdown(table) for table in printed[name])
            (folder / f"{name}.md").write_text(text, encoding="utf-8")
            text = "\n".join(latex(table, f"{name}-{index}") for index, table in enumerate(printed[name], 1))
            (folder / f"{name}.tex").write_text(text, encoding="utf-8")
        (folder / "index.html").write_text(page, encoding="utf-8")


def _retitled(table: Table, before: str) -> Table:
    """Copy the table with words before its title."""
    return Table(before + table.title, table.columns, table.rows, table.notes, table.best, table.status)


def _degraded(rows: Sequence[Row]) -> dict[str, list[str]]:
    """List the reasons of each scene that is degraded."""
    out: dict[str, list[str]] = {}
    for row in rows:
        if row["status"] == "degraded" and row["reasons"] not in out.setdefault(row["scene"], []):
            out[row["scene"]].append(row["reasons"])
    return out
