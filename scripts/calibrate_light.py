"""Find the light over the table of the work place."""

from typing import TYPE_CHECKING

from gsbridge.environment.light import FilmedShadow, calibrate_light
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
shown = FilmedShadow.of(dict(snakemake.input.items()))
calibrate_light(snakemake.output.record, robot=snakemake.input.robot, shown=shown)
