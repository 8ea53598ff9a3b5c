"""Compare the study of ways of learning with its floors."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_policies import write_study_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_study_figures(snakemake.output.measured, snakemake.input.study, snakemake.params.preset)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area="study",
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
