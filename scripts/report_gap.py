"""Write the report of one case."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.gap.page import CaseFiles, write_gap_report

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_gap_report(
    snakemake.wildcards.case,
    CaseFiles(
        snakemake.input.record,
        snakemake.input.comparison,
        snakemake.input.screening,
        snakemake.input.findings,
        snakemake.input.series,
        snakemake.input.replays,
    ),
    snakemake.output.page,
)
