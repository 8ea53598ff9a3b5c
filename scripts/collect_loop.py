"""Collect the success rates before and after the arm's model was amended, and what the finding cost."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.loop import LoopFiles, write_loop

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
files = LoopFiles(
    snakemake.params.cell,
    snakemake.params.plan,
    snakemake.input.trials,
    snakemake.input.trainings,
    snakemake.input.logged,
    snakemake.input.calibration,
    snakemake.input.findings,
    snakemake.input.amendment,
    snakemake.params.comparisons,
)
write_loop(files, snakemake.output.rows, snakemake.output.page, snakemake.output.figure)
