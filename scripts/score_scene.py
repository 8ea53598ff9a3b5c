"""Score one scene of the mirror against its truth."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.scene import write_scene_score

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_scene_score(
    snakemake.output.scores,
    scene=snakemake.wildcards.scene,
    kind=snakemake.params.kind,
    sfm_json=snakemake.input.sfm,
    views_json=snakemake.input.views,
    images=snakemake.input.images,
    truth_json=Path(snakemake.input.truth) / "truth.json",
    masks=snakemake.input.get("mask_images") or None,
    true_masks=Path(snakemake.input.truth) / "masks",
    visual=snakemake.input.visual,
    collision=snakemake.input.collision,
    true_mesh=Path(snakemake.input.truth) / "mesh.ply",
    masks_json=snakemake.input.get("masks") or None,
    mesh_json=snakemake.input.mesh,
    seed=snakemake.params.seed,
)
