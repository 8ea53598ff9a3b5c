"""Draw photo, soft, GaMeS, refined and their differences side by side."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.rendering_comparison import compared_scene, write_rendering_comparison

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_rendering_comparison(
    [compared_scene(Path("results/scenes") / scene) for scene in snakemake.params.scenes],
    snakemake.output.figure,
)
