"""Record the cameras and sparse points of one capture for rerun."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.recordings.sfm import record_sfm

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
record_sfm(
    model=snakemake.input.model,
    images=snakemake.input.images,
    sfm_json=snakemake.input.sfm,
    out=snakemake.output.recording,
)
