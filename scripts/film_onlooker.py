"""Film trials of one policy from beside the table."""

from typing import TYPE_CHECKING

from gsbridge.environment.build import StageFiles
from gsbridge.logs import start
from gsbridge.report.figures.onlooker_films import write_onlooker_film
from gsbridge.report.figures.paired_trials import ShownTrials
from gsbridge.report.tables.result_paths import CellPaths

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
files = zip(snakemake.params.worlds, snakemake.params.seeds, snakemake.input.tables, snakemake.input.logs, strict=True)
write_onlooker_film(
    CellPaths(**dict(snakemake.wildcards.items())),
    [ShownTrials(*file) for file in files],
    StageFiles.of(dict(snakemake.input.items())),
    snakemake.output.film,
)
