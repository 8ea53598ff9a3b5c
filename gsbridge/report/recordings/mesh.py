"""Recording of the mesh stage: visual and collision mesh in the table frame."""

from __future__ import annotations

from pathlib import Path

import rerun.blueprint as rrb

from gsbridge.meshes import read_mesh
from gsbridge.report.recordings.recording import log_mesh, log_scene_axes, recording
from gsbridge.report.tables.result_paths import scene_of

COLLISION_COLOUR = (235, 160, 60)
VISUAL_COLOUR = (200, 205, 215)


def record_mesh(visual: str | Path, collision: str | Path | None, out: str | Path) -> None:
    """Record the meshes of one scene.

    Entities: `table/axes`, `table/visual`, `table/collision`.

    Args:
        visual: Mesh that splats bind to.
        collision: Watertight mesh of an object; None for a background.
        out: The `.rrd`.

    Raises:
        InputError: A mesh cannot be read.
    """
    shapes = {"visual": (read_mesh(visual), VISUAL_COLOUR)}
    if collision is not None:
        shapes["collision"] = (read_mesh(collision), COLLISION_COLOUR)
    views = [rrb.Spatial3DView(origin="table", name=name, contents=["table/axes", f"table/{name}"]) for name in shapes]
    with recording(out, "mesh", scene_of(visual), rrb.Horizontal(*views)) as stream:
        log_scene_axes(stream, 0.05)
        for name, (mesh, colour) in shapes.items():
            log_mesh(stream, f"table/{name}", mesh, colour)
