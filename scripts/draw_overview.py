"""Draw the whole way of one policy, from its films to its trials, as one picture and as a clip."""

from typing import TYPE_CHECKING

from gsbridge.environment.build import StageFiles
from gsbridge.logs import start
from gsbridge.report.figures.overview import FilmedScene, write_overview
from gsbridge.report.figures.paired_trials import ShownTrials
from gsbridge.report.tables.result_paths import CellPaths

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
given = dict(snakemake.input.items())
trials = zip(snakemake.params.worlds, snakemake.params.seeds, snakemake.input.tables, snakemake.input.logs, strict=True)
write_overview(
    CellPaths(**dict(snakemake.wildcards.items())),
    [ShownTrials(*trial) for trial in trials],
    StageFiles.of(given),
    {
        name: FilmedScene(given[f"{name}_views"], given[f"{name}_images"], snakemake.params.filmed[name])
        for name in ("item", "background")
    },
    dict(snakemake.output.items()),
)
