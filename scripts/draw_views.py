"""Draw what the wrist camera sees of one object on one background."""

from typing import TYPE_CHECKING

from gsbridge.cameras import read_views
from gsbridge.environment.build import StageFiles, plate_of
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.environment.views import draw_views
from gsbridge.logs import start
from gsbridge.scene.photos import photo_colour

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
settings = snakemake.params.settings
draw_views(
    StageFiles.of(
        dict(snakemake.input.items()),
        item_colour=photo_colour(read_views(snakemake.input.views, snakemake.input.images), snakemake.input.masks),
    ),
    EnvironmentSettings(image_size=settings["size"], plate=plate_of(snakemake.input.item, snakemake.input.background)),
    snakemake.output.pictures,
    snakemake.output.record,
    count=settings["count"],
)
