"""Simulate the signatures of the known effects for one case."""

from typing import TYPE_CHECKING

from gsbridge.gap.workflow import write_screening
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_screening(
    snakemake.input.model, snakemake.input.data, snakemake.input.record, snakemake.params.bank, snakemake.output.screening
)
