"""Record the keyframes of one capture for rerun."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.recordings.capture import record_capture

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
record_capture(
    keyframes_json=snakemake.input.keyframes,
    frames=snakemake.input.frames,
    out=snakemake.output.recording,
)
