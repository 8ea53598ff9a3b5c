"""Recording of the asset stage: hulls, surface and splats of a body in its own frame, with its mass."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import trimesh

from gsbridge.asset.bundle import read_asset
from gsbridge.files import read_json
from gsbridge.meshes import Mesh
from gsbridge.report.recordings.recording import log_mesh, log_scene_axes, recording
from gsbridge.report.tables.result_paths import scene_of

_SURFACE = (200, 205, 215)


def record_asset(asset_json: str | Path, out: str | Path) -> None:
    """Record the bundle of one scene.

    Entities: `body/axes`, `body/surface`, `body/hulls/*` (a colour each), `body/splats` (rerun's Gaussian splats),
    `body/centre_of_mass`, `summary`.

    Args:
        asset_json: Record of the stage; the bundle lies beside it.
        out: The `.rrd`.

    Raises:
        InputError: A file is missing or damaged.
    """
    asset, record = read_asset(asset_json), read_json(asset_json)
    cloud = asset.cloud()
    rgba = np.rint(np.c_[np.clip(cloud.colours, 0, 1), cloud.opacities] * 255).astype(np.uint8)
    names = ("hulls", "surface", "splats") if asset.hulls else ("surface", "splats")
    views = [
        rrb.Spatial3DView(origin="body", name=name, contents=["body/axes", "body/centre_of_mass", f"body/{name}/**"])
        for name in names
    ]
    layout = rrb.Vertical(rrb.Horizontal(*views), rrb.TextDocumentView(origin="summary", name="Summary"), row_shares=[3, 1])
    with recording(out, "asset", scene_of(asset_json), layout) as stream:
        log_scene_axes(stream, 0.05, "body/axes")
        log_mesh(stream, "body/surface", asset.mesh(), _SURFACE)
        colours = matplotlib.colormaps["tab20"](np.arange(len(asset.hulls)) % 20)
        for path, colour in zip(asset.hulls, colours, strict=True):
            hull = trimesh.load_mesh(path, process=False)
            mesh = Mesh(np.asarray(hull.vertices, float), np.asarray(hull.faces, int))
            log_mesh(stream, f"body/hulls/{path.stem}", mesh, [round(255 * value) for value in colour[:3]])
        stream.log(
            "body/splats",
            # rerun wants quaternions as xyzw.
            rr.GaussianSplats3D(cloud.means, scales=cloud.scales, quaternions=cloud.quats[:, [1, 2, 3, 0]], colors=rgba),
            static=True,
        )
        if asset.properties is not None:
            centre = rr.Points3D([asset.properties.centre], radii=[0.003], colors=[(220, 40, 40)], labels=["centre of mass"])
            stream.log("body/centre_of_mass", centre, static=True)
        stream.log("summary", rr.TextDocument(_summary(record), media_type="text/markdown"), static=True)


def _summary(record: dict) -> str:
    """What the body is, as Markdown."""
    lines = [f"- {record['kind']}, status {record['status']}", *(f"- {reason}" for reason in record["reasons"])]
    if record["body"] is not None:
        body, rest = record["body"], record["rest"]
        lines += [
            f"- mass {1e3 * body['mass']:.0f} g = {1e6 * body['volume']:.0f} cm3 at {body['density']:.0f} kg/m3",
            f"- {record['hulls']['count']} convex hulls, {record['hulls']['vertices']} vertices",
            f"- at rest: {rest['penetration_mm']:.2f} mm deep, moved {rest['drift_mm']:.2f} mm, {rest['drift_deg']:.2f} deg",
        ]
    if record["photos"]:
        photos = record["photos"]
        lines.append(f"- against the photos: {photos['psnr']:.2f} dB, the splats stage {photos['stage_psnr']:.2f} dB")
    return "\n".join(lines)
