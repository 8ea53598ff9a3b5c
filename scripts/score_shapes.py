"""Compare the reconstruction of hollow, wide-footed, see-through and plain things with the floors."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_shapes import write_shape_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_shape_figures(
    snakemake.output.measured,
    snakemake.output.longest,
    scene_scores=snakemake.input.scenes,
    takes=snakemake.params.takes,
    longest=snakemake.params.longest,
    trials=snakemake.params.trials,
    preset=snakemake.params.preset,
)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area="shapes",
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
