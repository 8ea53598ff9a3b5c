"""Put the effects that were found for the arm into the simulation's model."""

from typing import TYPE_CHECKING

from gsbridge.gap.loop.amend import amend_simulation
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
amend_simulation(
    snakemake.input.nominal,
    snakemake.input.arm,
    snakemake.input.findings,
    snakemake.input.calibration,
    snakemake.output.model,
    snakemake.output.record,
)
