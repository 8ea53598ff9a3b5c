"""Choose the postures from which the wrist camera is photographed."""

from typing import TYPE_CHECKING

from gsbridge.environment.build import StageFiles, plate_of
from gsbridge.environment.postures import draw_postures
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
draw_postures(
    StageFiles.of(dict(snakemake.input.items())),
    EnvironmentSettings(image_size=snakemake.params.size, plate=plate_of(snakemake.input.item, snakemake.input.background)),
    snakemake.output.views,
    snakemake.output.record,
    count=snakemake.params.postures,
    seed=snakemake.params.seed,
)
