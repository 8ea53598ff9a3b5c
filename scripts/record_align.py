"""Record the alignment of one scene for rerun."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.photogrammetry.board import optional_board
from gsbridge.report.recordings.align import record_align

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
record_align(
    align_json=snakemake.input.align,
    views_json=snakemake.input.views,
    images=snakemake.input.images,
    points=snakemake.input.points,
    tags_json=snakemake.input.tags,
    board=optional_board(snakemake.params.board),
    out=snakemake.output.recording,
)
