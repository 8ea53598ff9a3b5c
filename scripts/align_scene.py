"""Align one scene with its table and find its scale."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.align.stage import align_scene
from gsbridge.configuration.align import AlignSettings
from gsbridge.logs import start
from gsbridge.photogrammetry.board import optional_board

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
align_scene(
    sfm_json=Path(snakemake.input.sfm),
    model=Path(snakemake.input.model),
    tags=Path(snakemake.input.tags),
    out_json=Path(snakemake.output.align),
    out_views=Path(snakemake.output.views),
    out_points=Path(snakemake.output.points),
    settings=AlignSettings(**snakemake.params.settings, require_scale=snakemake.params.require_scale),
    board=optional_board(snakemake.params.board),
    known_length=snakemake.params.known_length,
    seed=snakemake.params.seed,
)
