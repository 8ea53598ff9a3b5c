"""Compare success rates at different severities."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.tables.severity import write_severity

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_severity(snakemake.output.rows, snakemake.output.page, snakemake.params.sources)
