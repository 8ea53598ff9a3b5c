"""Record the learning curve of one policy for rerun."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.recordings.training import record_training

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
record_training(snakemake.input.curve, snakemake.input.record, snakemake.params.name, snakemake.output.recording)
