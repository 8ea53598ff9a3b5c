"""Compare the policies of the tables, in worlds of higher severity, with their floors."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_severity import write_severity_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_severity_figures(snakemake.output.measured, snakemake.input.rows or None, snakemake.params.preset)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area="severity",
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
