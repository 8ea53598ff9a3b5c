"""Write the page of the blind benchmark."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.gap.benchmark_page import write_gap_benchmark

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
given = snakemake.input
write_gap_benchmark(
    given.scores,
    given.floors,
    snakemake.params.preset,
    snakemake.output.page,
    real=given.get("real"),
    arm=given.get("arm"),
)
