"""Collect the findings of all cases of the gap."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.gap.rows import write_gap_rows

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_gap_rows(dict(zip(snakemake.params.cases, snakemake.input.findings, strict=True)), snakemake.output.rows)
