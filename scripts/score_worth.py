"""Compare the lead of splats over meshes, and how well simulation predicts graded policies, with the floors."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_severity import write_worth_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_worth_figures(
    snakemake.output.measured,
    worth=snakemake.input.worth or None,
    graded=snakemake.input.graded or None,
    preset=snakemake.params.preset,
)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area="worth",
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
