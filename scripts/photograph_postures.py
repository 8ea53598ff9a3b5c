"""Photograph the chosen postures with the wrist camera of a world of the mirror."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.environment.postures import STATES
from gsbridge.logs import start
from gsbridge.reality.world.camera import Setting
from gsbridge.reality.world.views import SensorExposure, photograph_postures
from gsbridge.reality.world.world_variants import configured_world

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
asked, cell, world = snakemake.params, snakemake.params.cell, snakemake.params.world
photograph_postures(
    Path(snakemake.input.views) / STATES,
    Setting(cell["object"], cell["background"], asked.sheet, asked.seed),
    configured_world(asked.seed, world, snakemake.wildcards.world),
    snakemake.output.photos,
    snakemake.output.record,
    SensorExposure(asked.pieces, asked.size, asked.samples, snakemake.threads, asked.first, snakemake.input.item),
    shots=asked.shots,
    seed=world["seed"],
)
