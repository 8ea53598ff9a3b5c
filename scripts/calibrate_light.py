"""Find the light over the table of the work place."""

from typing import TYPE_CHECKING

from gsbridge.cameras import read_views
from gsbridge.environment.light import calibrate_light
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
given = snakemake.input
shown = {}
if hasattr(given, "item"):
    shown = {
        "item": given.item,
        "views": read_views(given.views, given.images),
        "masks": given.masks,
        "background": given.background,
    }
calibrate_light(snakemake.output.record, robot=given.robot, **shown)
