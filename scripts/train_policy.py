"""Train one policy in the simulated world."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.cameras import read_views
from gsbridge.configuration.policy import PolicySettings
from gsbridge.environment.build import StageFiles, plate_of
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.logs import start
from gsbridge.policy.stage import train_policy
from gsbridge.scene.photos import photo_colour

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
settings, item = PolicySettings(**snakemake.params.settings), snakemake.input.item
train_policy(
    StageFiles.of(
        dict(snakemake.input.items()),
        item_colour=photo_colour(read_views(snakemake.input.views, snakemake.input.images), snakemake.input.masks),
    ),
    EnvironmentSettings(
        task=snakemake.wildcards.task,
        image_size=settings.image_size,
        renderer=snakemake.wildcards.renderer,
        plate=plate_of(item, snakemake.input.background),
    ),
    settings,
    Path(snakemake.output.spec).parent,
    snakemake.output.record,
    seed=int(snakemake.wildcards.seed),
    state=snakemake.params.state,
    controller_offset=tuple(snakemake.params.controller_offset),
    unchanged_teacher=snakemake.params.unchanged_teacher,
)
