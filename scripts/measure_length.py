"""Measure the longest side of one object in the units of its reconstruction, from a mesh at a provisional scale."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.align.stage import align_scene
from gsbridge.cameras import read_views
from gsbridge.configuration.align import AlignSettings
from gsbridge.configuration.masks import MaskSettings
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.files import read_json, write_json
from gsbridge.logs import start
from gsbridge.masks import segment_object
from gsbridge.mesh import mesh_object
from gsbridge.meshes import read_mesh
from gsbridge.photogrammetry.standing import box_sides

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
files, options = snakemake.input, snakemake.params
work, sfm = Path(options.workspace), Path(files.sfm)
common = {"settings": AlignSettings(**options.align), "board": None, "known_length": None, "seed": options.seed}
paths = {"sfm_json": sfm, "model": Path(files.model), "tags": Path(files.tags), "out_points": work / "points.npz"}
align_scene(**paths, **common, out_json=work / "align.json", out_views=work / "views.json", up=options.up)
views, points = read_views(work / "views.json", files.images), work / "points.npz"
segmented = work / "masks.json"
segment_object(views, points, work / "masks", segmented, MaskSettings(**options.masks), options.seed, points=options.points)
mesh_files = [work / name for name in ("visual.ply", "collision.ply", "mesh.json")]
mesh_object(views, work / "masks", points, *mesh_files, MeshSettings(**options.mesh), options.seed)
side = float(box_sides(read_mesh(mesh_files[0]).vertices).max()) / read_json(work / "align.json")["scale"]
write_json(
    snakemake.output.length,
    {"side": side, "doubts": [doubt for path in (segmented, mesh_files[2]) for doubt in read_json(path)["reasons"]]},
)
