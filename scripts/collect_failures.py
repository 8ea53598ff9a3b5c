"""Collect how the trials ended."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.tables.failures import write_failure_rows

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_failure_rows(snakemake.output.rows, snakemake.input.trials, robot=snakemake.params.robot)
