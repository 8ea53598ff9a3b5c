"""Record the meshes of one scene for rerun."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.recordings.mesh import record_mesh

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
record_mesh(
    visual=snakemake.input.visual,
    collision=snakemake.input.collision,
    out=snakemake.output.recording,
)
