"""Compare the figures of Real2Sim with their floors."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_scenes import write_real2sim_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_real2sim_figures(
    snakemake.output.measured,
    scene_scores=snakemake.input.scenes,
    rendering_csv=snakemake.input.rendering,
    films=snakemake.params.films,
    real=snakemake.params.real,
    rasterizer=snakemake.input.rasterizer,
    preset=snakemake.params.preset,
)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area="real2sim",
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
