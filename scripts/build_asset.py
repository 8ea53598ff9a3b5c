"""Bundle one scene as an asset for simulators."""

from typing import TYPE_CHECKING

from gsbridge.asset.photos import AssetPhotos
from gsbridge.asset.stage import AssetInputs, AssetOutputs, build_asset
from gsbridge.cameras import read_views
from gsbridge.configuration.asset import AssetSettings
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
build_asset(
    AssetInputs(snakemake.input.visual, snakemake.input.collision, snakemake.input.splats, snakemake.input.align),
    AssetOutputs(
        snakemake.output.urdf,
        snakemake.output.hulls,
        snakemake.output.visual,
        snakemake.output.splats,
        snakemake.output.record,
    ),
    AssetSettings(**snakemake.params.settings),
    name=snakemake.wildcards.scene,
    kind=snakemake.params.kind,
    seed=snakemake.params.seed,
    photos=AssetPhotos(
        views=read_views(snakemake.input.views, snakemake.input.images),
        masks=snakemake.input.get("mask_images") or None,
        record=snakemake.input.splats_record,
        margin_px=snakemake.params.margin_px,
    ),
)
