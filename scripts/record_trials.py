"""Record the trials of one policy for rerun."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.paired_trials import ShownTrials
from gsbridge.report.recordings.trials import record_trials
from gsbridge.report.tables.result_paths import CellPaths

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
files = zip(snakemake.params.worlds, snakemake.params.seeds, snakemake.input.tables, snakemake.input.logs, strict=True)
record_trials(
    CellPaths(**dict(snakemake.wildcards.items())),
    [ShownTrials(*file) for file in files],
    snakemake.input.item,
    snakemake.input.background,
    snakemake.output.recording,
)
