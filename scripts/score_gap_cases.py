"""Score the findings of one tier of the blind benchmark against what was hidden."""

from typing import TYPE_CHECKING

from gsbridge.gap.benchmark.score import score_tier
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
score_tier(
    snakemake.input.cases,
    snakemake.input.truths,
    snakemake.input.findings,
    snakemake.params.methods,
    snakemake.params.chunks,
    snakemake.output.scores,
)
