"""Read and check the records of a case."""

from typing import TYPE_CHECKING

from gsbridge.gap.workflow import write_case_records
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_case_records(snakemake.input.case, snakemake.output.data, snakemake.output.record)
