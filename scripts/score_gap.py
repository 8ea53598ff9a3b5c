"""Compare figures about the gap with the floors: of the blind benchmark, or of logs of real machines."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_gap import write_gap_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_gap_figures(
    snakemake.output.measured,
    snakemake.input.get("scores", []),
    preset=snakemake.params.preset,
    real=snakemake.input.get("real"),
    arm=snakemake.input.get("arm"),
    mismatch=snakemake.input.get("mismatch"),
)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area=snakemake.wildcards.area,
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
