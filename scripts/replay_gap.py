"""Replay the records of a case with the model before and after."""

from typing import TYPE_CHECKING

from gsbridge.gap.workflow import write_replays
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_replays(
    snakemake.input.model,
    snakemake.input.data,
    snakemake.input.record,
    snakemake.input.findings,
    snakemake.output.series,
    snakemake.output.replays,
)
