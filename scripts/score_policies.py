"""Compare the policies with their floors."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_policies import write_policy_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_policy_figures(
    snakemake.output.measured,
    grasping=snakemake.input.grasping or None,
    renderer_contrast=snakemake.input.renderer_contrast or None,
    pick_and_place=snakemake.input.pick_and_place or None,
    training=snakemake.input.training or None,
    toy=snakemake.input.toy or None,
    wall_times=snakemake.input.wall_times or None,
    preset=snakemake.params.preset,
)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area="policies",
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
