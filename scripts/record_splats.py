"""Record the splats of one scene for rerun."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.recordings.splats import record_splats

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
record_splats(
    splats_ply=snakemake.input.splats,
    splats_json=snakemake.input.record,
    views_dir=snakemake.input.views,
    out=snakemake.output.recording,
)
