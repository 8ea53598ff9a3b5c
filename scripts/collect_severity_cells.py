"""Compare the policies of the tables at different severities, cell by cell."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.tables.severity_cells import write_cells_page
from gsbridge.report.tables.severity_rows import write_severity_rows

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_severity_rows(
    snakemake.output.rows,
    snakemake.input.trials,
    snakemake.params.severities,
    policies=snakemake.input.policies,
    records=snakemake.input.records,
)
write_cells_page(snakemake.output.rows, snakemake.output.page)
