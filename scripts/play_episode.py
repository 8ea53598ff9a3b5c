"""Let the baseline controller grasp one object on one background in the simulated world."""

from typing import TYPE_CHECKING

from gsbridge.cameras import read_views
from gsbridge.environment.build import StageFiles, plate_of
from gsbridge.environment.episode import play_episode
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.logs import start
from gsbridge.scene.photos import photo_colour

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
play_episode(
    StageFiles.of(
        dict(snakemake.input.items()),
        item_colour=photo_colour(read_views(snakemake.input.views, snakemake.input.images), snakemake.input.masks),
    ),
    EnvironmentSettings(
        task=snakemake.params.task,
        image_size=snakemake.params.size,
        plate=plate_of(snakemake.input.item, snakemake.input.background),
    ),
    snakemake.output.episode,
    snakemake.output.states,
    snakemake.output.record,
)
