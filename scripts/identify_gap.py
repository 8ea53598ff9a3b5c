"""Find what the model of a case lacks, and write the amended one."""

from typing import TYPE_CHECKING

from gsbridge.gap.workflow import write_findings
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_findings(
    snakemake.input.model,
    snakemake.input.data,
    snakemake.input.record,
    snakemake.params.bank,
    snakemake.output.findings,
    snakemake.output.model,
    snakemake.params.seed,
)
