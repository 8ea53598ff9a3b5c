"""How splats hold on to the mesh of an object."""

from __future__ import annotations

BINDINGS = ("games", "soft", "refined", "unbound", "games_vertices")
"""On the faces of a mesh that stays as it is (GaMeS); within a band around them (the paper's equation 2); the same, with turns
and scales free in a face's frame; on nothing; on faces whose vertices are trained along (GaMeS as its authors train it).
Recordings show the first three."""
