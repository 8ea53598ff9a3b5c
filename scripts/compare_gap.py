"""Replay the records of a case in its model, and compare."""

from typing import TYPE_CHECKING

from gsbridge.gap.workflow import write_comparison
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_comparison(snakemake.input.model, snakemake.input.data, snakemake.input.record, snakemake.output.comparison)
