"""Record the masks of one object for rerun."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.recordings.masks import record_masks

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
record_masks(
    views_json=snakemake.input.views,
    images=snakemake.input.images,
    masks=snakemake.input.masks,
    out=snakemake.output.recording,
)
