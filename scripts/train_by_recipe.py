"""Train the Gaussians of one object by the recipe for quality."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.cameras import read_views
from gsbridge.configuration.splats import SplatSettings
from gsbridge.files import read_json
from gsbridge.logs import start
from gsbridge.splats.degree import degree_of_photos
from gsbridge.splats.stage import train_splats

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
views, options = read_views(snakemake.input.views, snakemake.input.images), snakemake.params.settings
auto = {"sh_degree": degree_of_photos(len(views.of("train")))} if options["sh_degree"] == "auto" else {}
train_splats(
    views=views,
    masks_dir=snakemake.input.get("mask_images") or None,
    mesh_path=snakemake.input.mesh,
    out_ply=snakemake.output.splats,
    out_binding=snakemake.output.binding,
    out_views=snakemake.output.views,
    out_json=snakemake.output.record,
    settings=SplatSettings(**{**options, **auto}),
    binding=snakemake.wildcards.binding,
    seed=snakemake.params.seed,
    threads=snakemake.threads,
    state=Path(snakemake.params.state),
    kind=snakemake.params.kind,
    surface=snakemake.params.surface,
    scene_unit=read_json(snakemake.input.align)["metres_per_unit"],
)
