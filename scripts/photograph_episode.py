"""Photograph one episode of the simulated world with the mirror's wrist camera."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.reality.world.camera import Setting
from gsbridge.reality.world.episode import photograph_episode
from gsbridge.reality.world.views import SensorExposure

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
settings = snakemake.params.settings
photograph_episode(
    snakemake.input.states,
    Setting(snakemake.wildcards.object, snakemake.wildcards.background, snakemake.params.sheet, snakemake.params.seed),
    snakemake.params.seed,
    snakemake.output.photos,
    snakemake.output.record,
    SensorExposure(
        snakemake.params.pieces, settings["size"], settings["samples"], snakemake.threads, item=snakemake.input.item
    ),
    every=settings["every"],
)
