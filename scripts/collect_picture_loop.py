"""Collect the success rates before and after the camera's model was amended, and what the finding cost."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.loop import PictureLoopFiles, write_picture_loop

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
files = PictureLoopFiles(
    snakemake.params.cell,
    snakemake.params.plan,
    snakemake.params.worlds,
    snakemake.input.trials,
    snakemake.input.trainings,
    snakemake.input.photos,
    snakemake.input.findings,
    snakemake.params.comparisons,
)
write_picture_loop(files, snakemake.output.rows, snakemake.output.page, snakemake.output.figure)
