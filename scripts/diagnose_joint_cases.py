"""Diagnose a chunk of the blind benchmark's cases of joints."""

from typing import TYPE_CHECKING

from gsbridge.gap.benchmark.chunks import diagnose_chunk
from gsbridge.gap.benchmark.joint_diagnosis import diagnose_joint_case
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
diagnose_chunk(
    snakemake.input.cases,
    int(snakemake.wildcards.chunk),
    snakemake.params.chunks,
    diagnose_joint_case,
    snakemake.wildcards.method,
    snakemake.params.bank,
    snakemake.params.state,
    snakemake.output.findings,
    snakemake.params.seed,
)
