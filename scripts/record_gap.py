"""Record measured, nominal and explained motion of one case for rerun."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.recordings.gap import record_gap

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
record_gap(
    snakemake.input.model,
    snakemake.input.findings,
    snakemake.input.series,
    snakemake.input.replays,
    snakemake.wildcards.case,
    snakemake.output.recording,
)
