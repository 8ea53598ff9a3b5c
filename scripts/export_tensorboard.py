"""Write the learning curve of one policy for TensorBoard."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.recordings.tensorboard import write_events

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_events(snakemake.input.curve, snakemake.output.events)
