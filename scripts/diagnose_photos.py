"""Find what changed between photos of two days."""

from typing import TYPE_CHECKING

from gsbridge.gap.image.workflow import write_image_findings
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_image_findings(
    snakemake.input.views,
    snakemake.input.before,
    snakemake.input.after,
    snakemake.output.findings,
    snakemake.output.pictures,
    seed=snakemake.params.seed,
    shot=snakemake.params.shot,
)
