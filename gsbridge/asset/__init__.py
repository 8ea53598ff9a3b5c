"""Assets: all files that a simulator needs of a captured object or background, bundled in one folder.

An object becomes a rigid body: convex hulls, mass, centre of mass and inertia, a URDF, and its splats and visual mesh in the
body frame. A background becomes a static concave body in the table frame.
"""
