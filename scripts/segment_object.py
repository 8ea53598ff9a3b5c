"""Segment the object in every registered photo."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.cameras import read_views
from gsbridge.configuration.masks import MaskSettings
from gsbridge.logs import start
from gsbridge.masks.segment import segment_object

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
segment_object(
    views=read_views(snakemake.input.views, snakemake.input.images),
    points_npz=Path(snakemake.input.points),
    out_images=Path(snakemake.output.images),
    out_json=Path(snakemake.output.masks),
    settings=MaskSettings(**snakemake.params.settings),
    seed=snakemake.params.seed,
    threads=snakemake.threads,
    points=snakemake.params.points,
)
