"""Let a policy act in a world of the mirror, once from every start pose of all sets."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.environment.policy_trials import TrialPlace
from gsbridge.logs import start
from gsbridge.policy.trials import try_in_mirror
from gsbridge.reality.world.camera import Setting
from gsbridge.reality.world.world_variants import configured_world

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
seed, world = snakemake.params.seed, snakemake.params.world
try_in_mirror(
    Path(snakemake.input.spec).parent,
    snakemake.input.training,
    Setting(snakemake.wildcards.object, snakemake.wildcards.background, snakemake.params.sheet, seed),
    configured_world(seed, world, snakemake.wildcards.world),
    snakemake.input.registration,
    TrialPlace(snakemake.output.table, snakemake.output.log, snakemake.output.record, snakemake.params.state),
    name=snakemake.wildcards.world,
    poses=snakemake.params.poses,
    outside=snakemake.params.outside,
    pieces=snakemake.params.pieces,
)
