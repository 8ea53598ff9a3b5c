"""Compare the reconstruction of real things, photographed by others, with the floors."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_photos import write_photo_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_photo_figures(
    snakemake.output.measured,
    scenes=snakemake.params.scenes,
    references=snakemake.input.references,
    preset=snakemake.params.preset,
)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area="photos",
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
