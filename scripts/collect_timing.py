"""Collect wall time, processor time and memory of all jobs."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.tables.timing import write_timing_rows

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_timing_rows(sorted(Path(snakemake.params.benchmarks).rglob("*.jsonl")), snakemake.output.rows)
