"""Collect the time and the success of the trainings."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.tables.training import write_training_rows

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_training_rows(snakemake.input.policies, snakemake.input.curves, snakemake.output.rows)
