"""Let the baseline controller work in the simulated world."""

from typing import TYPE_CHECKING

from gsbridge.environment.build import StageFiles, build_controller, build_world, plate_of
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.environment.trials import try_controller
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
trials = snakemake.params.trials
files = StageFiles.of(dict(snakemake.input.items()))
settings = EnvironmentSettings(task=snakemake.wildcards.task, image_size=64, plate=plate_of(files.item, files.background))
try_controller(
    build_world(files),
    build_controller(files.item, settings),
    settings,
    snakemake.output.record,
    seeds=range(trials["seeds"]),
    poses=trials["poses"],
    name="sim",
)
