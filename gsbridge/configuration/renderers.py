"""What draws the pictures that a policy learns from."""

from __future__ import annotations

from typing import Literal, get_args

RendererName = Literal["gs", "gs_soft", "mesh_vertex_shaded", "mesh_shaded", "mesh_vertex", "mesh"]

RENDERERS: tuple[RendererName, ...] = get_args(RendererName)
"""All of them, the most faithful first."""

TITLES: dict[str, str] = {
    "gs": "splats",
    "gs_soft": "soft splats",
    "mesh_vertex_shaded": "mesh, vertex colours and shadows",
    "mesh_shaded": "mesh, shadows",
    "mesh_vertex": "mesh, vertex colours",
    "mesh": "mesh (RL-sim)",
}
"""What pages call them."""

SHADED = tuple(name for name in RENDERERS if name not in ("mesh_vertex", "mesh"))
"""Renderers that draw the shadows of robot and object; the paper's control, RL-sim, draws none."""

SPLATS = ("gs", "gs_soft")
"""Renderers that draw splats."""


def trained_on(renderer: str) -> str:
    """What follows a policy's name on pages; nothing for splats, the paper's way."""
    return "" if renderer == "gs" else f", {TITLES.get(renderer, renderer)}"
