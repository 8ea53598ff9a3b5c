"""Draw the learning curves of all policies."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.learning_curves import write_learning_curves

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_learning_curves(snakemake.input.curves, snakemake.output.figure)
