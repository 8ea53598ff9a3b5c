"""Draw the success rate of every cell in both worlds."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.success import write_success_figure

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_success_figure(snakemake.input.rows, snakemake.output.figure)
