"""Compare the policies in further worlds with their floors."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_policies import write_world_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_world_figures(snakemake.output.measured, snakemake.input.worlds, snakemake.params.preset)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area="worlds",
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
