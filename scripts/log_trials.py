"""Repeat trials of a policy in a world of the mirror, and write what the arm's driver logs."""

from typing import TYPE_CHECKING

from gsbridge.environment.build import plate_of
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.logs import start
from gsbridge.policy.joint_log import ROLES, log_trials
from gsbridge.reality.world.camera import Setting
from gsbridge.reality.world.driver_log import logged_physics
from gsbridge.reality.world.world_variants import configured_world
from gsbridge.registration.result import read_registration

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
cell, seed, world = snakemake.params.cell, snakemake.params.seed, snakemake.params.world
log_trials(
    snakemake.input.table,
    snakemake.input.log,
    logged_physics(
        Setting(cell["object"], cell["background"], snakemake.params.sheet, seed),
        configured_world(seed, world, snakemake.wildcards.world),
        pieces=snakemake.params.pieces,
    ),
    read_registration(snakemake.input.registration),
    EnvironmentSettings(task=cell["task"], image_size=64, plate=plate_of(snakemake.input.item, snakemake.input.background)),
    {role: snakemake.output[role] for role in ROLES},
    snakemake.output.record,
    name=snakemake.wildcards.world,
)
