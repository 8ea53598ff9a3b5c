"""Record what each job took, for as long as `benchmarks/evidence` is kept."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.evidence import write_timings

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_timings(snakemake.params.benchmarks, snakemake.output.timings)
