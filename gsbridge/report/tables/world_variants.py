"""Tables in Markdown of the paper's policies in further worlds."""

from __future__ import annotations

from pathlib import Path

from gsbridge.files import atomic_file
from gsbridge.report.tables.formats import markdown
from gsbridge.report.tables.rows import read_rows
from gsbridge.report.tables.success import COUNT_NOTE, mirrors_table, summary_table
from gsbridge.report.tables.success_rows import COLUMNS


def write_world_variants(rows_csv: str | Path, page: str | Path) -> None:
    """Write the page: means over the grasp cells, then every cell in every world.

    Args:
        rows_csv: Rows `worlds.csv` of successes.
        page: Markdown file to write.

    Raises:
        InputError: The rows are damaged.
    """
    rows = read_rows(rows_csv, COLUMNS)
    found = (
        summary_table(rows, "grasp", title="Grasping: means over the cells"),
        mirrors_table(rows, title="Every policy"),
    )
    text = "\n".join(markdown(table) for table in found if table is not None)
    with atomic_file(page) as temporary:
        temporary.write_text(f"# The same policies in further worlds\n\n{text}\n{COUNT_NOTE}\n", encoding="utf-8")
