"""Collect the rows of the rendering table."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.tables.rendering_rows import write_rendering_rows

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_rendering_rows(
    snakemake.input.splats,
    snakemake.output.rows,
    scenes=snakemake.params.scenes,
    films=snakemake.params.films,
    records=snakemake.input.records,
)
