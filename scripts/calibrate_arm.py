"""Calibrate the model of the simulated arm with the records of a case."""

from typing import TYPE_CHECKING

from gsbridge.gap.loop.stages import calibrate_arm
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
calibrate_arm(snakemake.input.case, snakemake.output.model, snakemake.output.record)
