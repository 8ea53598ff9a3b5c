"""Put the effects that were found for a thrown object into the simulation's model."""

from typing import TYPE_CHECKING

from gsbridge.gap.loop.amend import amend_object
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
amend_object(snakemake.input.nominal, snakemake.input.findings, snakemake.output.model)
