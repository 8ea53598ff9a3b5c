"""Compare the figures of the simulator with their floors."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.measured_scenes import write_simulator_figures
from gsbridge.report.scores.score import write_scores

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_simulator_figures(
    snakemake.output.measured,
    assets=snakemake.input.assets,
    sim=snakemake.input.sim,
    mirror=snakemake.input.mirror,
    checks=snakemake.input.checks,
    views=snakemake.input.views,
    eye_in_hand=snakemake.input.eye_in_hand,
    registration=snakemake.input.registration,
    environment=snakemake.input.environment,
    preset=snakemake.params.preset,
)
write_scores(
    snakemake.input.floors,
    [snakemake.output.measured],
    snakemake.output.scores,
    area="simulator",
    preset=snakemake.params.preset,
    provenance=snakemake.params.behind,
)
