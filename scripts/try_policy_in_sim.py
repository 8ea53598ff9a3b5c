"""Let a policy act in the simulated world, once from every start pose of both sets."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.cameras import read_views
from gsbridge.environment.build import StageFiles, plate_of
from gsbridge.environment.policy_trials import TrialPlace
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.logs import start
from gsbridge.policy.trials import try_in_sim
from gsbridge.scene.photos import photo_colour

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
item = snakemake.input.item
try_in_sim(
    Path(snakemake.input.spec).parent,
    snakemake.input.training,
    StageFiles.of(
        dict(snakemake.input.items()),
        item_colour=photo_colour(read_views(snakemake.input.views, snakemake.input.images), snakemake.input.masks),
    ),
    EnvironmentSettings(
        task=snakemake.wildcards.task,
        image_size=snakemake.params.image_size,
        renderer=snakemake.wildcards.renderer,
        plate=plate_of(item, snakemake.input.background),
    ),
    TrialPlace(snakemake.output.table, snakemake.output.log, snakemake.output.record, snakemake.params.state),
    poses=snakemake.params.poses,
    outside=snakemake.params.outside,
)
