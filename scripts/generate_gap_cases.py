"""Generate the cases of one tier of the blind benchmark, with effects hidden in them."""

from typing import TYPE_CHECKING

from gsbridge.gap.benchmark.drawing import generate_tier
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
generate_tier(
    snakemake.wildcards.tier,
    snakemake.params.split,
    snakemake.params.cases_wanted,
    snakemake.params.seed,
    snakemake.output.cases,
    snakemake.output.truths,
    photos=list(snakemake.input.photos),
    renders=list(snakemake.input.renders),
    seal=snakemake.params.seal,
)
