"""Compare the closed loops with their floors."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_policies import write_loop_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_loop_figures(
    snakemake.output.measured,
    {name: path for name, path in snakemake.input.items() if name != "floors"},
    snakemake.params.loops,
    snakemake.params.preset,
)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area="loops",
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
