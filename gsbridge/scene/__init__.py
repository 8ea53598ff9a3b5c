"""A scene to look at: splats or meshes of a background and of bodies that physics moves, and their images."""
