"""Compare ways of learning."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.study import write_study

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_study(snakemake.input.trainings, snakemake.input.trials, snakemake.output.rows, snakemake.output.page)
