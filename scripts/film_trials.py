"""Film the trials of one policy."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.paired_trials import ShownTrials
from gsbridge.report.figures.trial_films import write_trial_film
from gsbridge.report.tables.result_paths import CellPaths

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
files = zip(snakemake.params.worlds, snakemake.params.seeds, snakemake.input.tables, snakemake.input.logs, strict=True)
write_trial_film(
    CellPaths(**dict(snakemake.wildcards.items())),
    [ShownTrials(*file) for file in files],
    snakemake.output.film,
)
