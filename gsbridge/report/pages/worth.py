"""Rows, page and figure of a comparison of policies at different severities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from gsbridge.report.figures.worth import write_graded_figure, write_worth_figure
from gsbridge.report.tables.severity_rows import write_severity_rows
from gsbridge.report.tables.worth import write_graded_page, write_worth_page

_WRITERS = {"worth": (write_worth_page, write_worth_figure), "graded": (write_graded_page, write_graded_figure)}


def write_comparison(
    who: str,
    trials: Sequence[str | Path],
    policies: Sequence[str | Path],
    severities: Mapping[str, tuple[int, int]],
    *,
    records: Sequence[str | Path] = (),
    rows: str | Path,
    page: str | Path,
    figure: str | Path,
) -> None:
    """Write a comparison as rows, as a page and as a figure.

    Args:
        who: `worth` (what splats are worth) or `graded` (how well simulation foretells policies of different skill).
        trials: Tables of trials, each beside its record.
        policies: Records of the trainings.
        severities: Severity of look and of physics by the name of a world.
        records: Records of the stages that made the scenes.
        rows: CSV file to write.
        page: Markdown file to write.
        figure: PNG file to write.

    Raises:
        InputError: A file is missing or damaged, or no world is named.
    """
    write_page, write_figure = _WRITERS[who]
    write_severity_rows(rows, trials, severities, policies=policies, records=records)
    write_page(rows, page)
    write_figure(rows, figure)
