"""Put the effects that were found between photos into the simulation's model."""

from typing import TYPE_CHECKING

from gsbridge.gap.image.workflow import amend_camera
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
amend_camera(snakemake.input.nominal, snakemake.input.findings, snakemake.output.model, snakemake.input.reference)
