"""Compare policies at different severities: splats with meshes, or graded policies in simulation and in the mirror."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.pages.worth import write_comparison

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_comparison(
    snakemake.wildcards.who,
    snakemake.input.trials,
    snakemake.input.policies,
    snakemake.params.severities,
    records=snakemake.input.records,
    rows=snakemake.output.rows,
    page=snakemake.output.page,
    figure=snakemake.output.figure,
)
