"""Meshes: watertight objects from outlines and multi-view depth, and the table as a height field."""

from gsbridge.configuration.mesh import MeshSettings
from gsbridge.mesh.background import mesh_background
from gsbridge.mesh.objects import mesh_object

__all__ = ["MeshSettings", "mesh_background", "mesh_object"]
