"""Let the baseline controller work in the mirror."""

from typing import TYPE_CHECKING

from gsbridge.environment.build import build_controller, plate_of
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.logs import start
from gsbridge.policy.arm_trials import try_controller_on_arm
from gsbridge.reality.world.camera import Setting
from gsbridge.reality.world.mirror import mirror_physics
from gsbridge.reality.world.world_variants import configured_world
from gsbridge.registration.result import read_registration

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
trials, item, background = snakemake.params.trials, snakemake.input.item, snakemake.input.background
settings = EnvironmentSettings(task=snakemake.wildcards.task, image_size=64, plate=plate_of(item, background))
try_controller_on_arm(
    mirror_physics(
        Setting(snakemake.wildcards.object, snakemake.wildcards.background, seed=snakemake.params.seed),
        configured_world(snakemake.params.seed, snakemake.params.world, snakemake.wildcards.world),
        pieces=snakemake.params.pieces,
    ),
    read_registration(snakemake.input.registration),
    build_controller(item, settings),
    settings,
    snakemake.output.record,
    seeds=range(trials["seeds"]),
    poses=trials["poses"],
    name=snakemake.wildcards.world,
)
