"""Collect the rows of a table of successes."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.tables.success_rows import write_success_rows

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_success_rows(
    snakemake.output.rows,
    snakemake.input.trials,
    robot=snakemake.params.robot,
    policies=snakemake.input.policies,
    records=snakemake.input.records,
)
