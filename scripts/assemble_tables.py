"""Assemble rows and figures into tables and the page."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.files import atomic_file
from gsbridge.logs import start
from gsbridge.report.pages.tables import write_tables

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_tables(
    rows=[snakemake.input.rendering, snakemake.input.timing, *snakemake.input.policies],
    figures=snakemake.input.figures,
    out_dir=snakemake.output.tables,
    preset=snakemake.params.preset,
    records=snakemake.input.records,
    policy_figures=snakemake.input.policy_figures,
    scene_pages=snakemake.input.pages,
    films=list(zip(snakemake.params.films, snakemake.input.films, strict=True)),
)
# The copy lies one folder higher, so its links to the pages of the scenes lose one `../`.
page = Path(snakemake.output.tables, "index.html").read_text(encoding="utf-8")
with atomic_file(snakemake.output.page) as part:
    part.write_text(page.replace('href="../', 'href="'), encoding="utf-8")
