"""Compare the hand's paths of all policies in simulation and in the mirror."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.behaviour import write_behaviour
from gsbridge.report.figures.paired_trials import trials_by_cell

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_behaviour(
    trials_by_cell(
        snakemake.params.cells,
        snakemake.params.worlds,
        snakemake.params.seeds,
        snakemake.input.tables,
        snakemake.input.logs,
    ),
    snakemake.output.figure,
    snakemake.output.rows,
)
