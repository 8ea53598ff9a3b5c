"""Mesh one object."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.cameras import read_views
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.logs import start
from gsbridge.mesh.objects import mesh_object

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
mesh_object(
    views=read_views(snakemake.input.views, snakemake.input.images),
    masks_dir=Path(snakemake.input.mask_images),
    points_npz=Path(snakemake.input.points),
    out_visual=Path(snakemake.output.visual),
    out_collision=Path(snakemake.output.collision),
    out_json=Path(snakemake.output.mesh),
    settings=MeshSettings(**snakemake.params.settings),
    seed=snakemake.params.seed,
    threads=snakemake.threads,
)
