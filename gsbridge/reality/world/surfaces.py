"""Materials of surfaces: matt, or glossy with highlights that move with the camera."""

from __future__ import annotations

from typing import Any

import numpy as np

from gsbridge.geometry import Array
from gsbridge.meshes import Mesh

_ROUGH, _SMOOTH = 0.7, 0.1
"""Roughness in the limit of no gloss, and at gloss 1 (a wet surface)."""

_DIELECTRIC = 0.5
"""Mitsuba's `specular` of plastic, lacquer, glaze and water: they reflect 4 % of light that falls on them perpendicularly."""


def coated(colour: Any, gloss: float) -> dict[str, Any]:
    """Describe a surface of a colour and gloss for Mitsuba.

    Args:
        colour: Reflectance: a Mitsuba texture, or its description.
        gloss: 0 matt, 0.45 rough plastic, 0.9 lacquer, 1 wet.

    Source: Burley, "Physically based shading at Disney", 2012, as Mitsuba's `principled` has it.
    """
    if gloss == 0.0:
        return {"type": "diffuse", "reflectance": colour}
    roughness = _ROUGH + (_SMOOTH - _ROUGH) * gloss
    return {"type": "principled", "base_color": colour, "roughness": roughness, "specular": _DIELECTRIC}


def painted(mi: Any, name: str, mesh: Mesh, normals: Array, gloss: float) -> Any:
    """Return a Mitsuba mesh with one colour per vertex, for bodies that do not move.

    Args:
        mi: The Mitsuba module.
        name: Name of the shape.
        mesh: Mesh with linear colours, m.
        normals: Normals of the mesh's vertices. [V, 3].
        gloss: See `coated`.
    """
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(coated({"type": "mesh_attribute", "name": "vertex_color"}, gloss))
    shape = mi.Mesh(name, len(mesh.vertices), len(mesh.faces), has_vertex_normals=True, props=properties)
    shape.add_attribute("vertex_color", 3, np.asarray(mesh.colours, dtype=np.float32).ravel())
    return filled(mi, shape, mesh, normals)


def filled(mi: Any, shape: Any, mesh: Mesh, normals: Array | None = None) -> Any:
    """Fill a Mitsuba mesh with vertices and triangles, and return it.

    Args:
        mi: The Mitsuba module.
        shape: The Mitsuba mesh, still empty.
        mesh: Vertices and triangles, m.
        normals: Normals of the vertices, [V, 3]; None for flat triangles.
    """
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = np.asarray(mesh.vertices, dtype=np.float32).ravel()
    if normals is not None:
        parameters["vertex_normals"] = np.asarray(normals, dtype=np.float32).ravel()
    parameters["faces"] = np.asarray(mesh.faces, dtype=np.uint32).ravel()
    parameters.update()
    return shape
