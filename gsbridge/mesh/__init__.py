"""Meshes: watertight objects from outlines and multi-view depth, and the table as a height field."""

from gsbridge.mesh.background import mesh_background
from gsbridge.mesh.objects import mesh_object
from gsbridge.mesh.settings import MeshSettings

__all__ = ["MeshSettings", "mesh_background", "mesh_object"]
