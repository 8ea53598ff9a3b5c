"""Closed meshes: remeshing within a face budget without losing watertightness, and resampling on a grid."""

from __future__ import annotations

import logging

import numpy as np
from scipy import ndimage

from gsbridge.geometry import Array
from gsbridge.libraries import import_open3d
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.carving import Grid, largest_component, mesh_of_field

logger = logging.getLogger("gsbridge")

_COARSE = 4


def depth_inside(mesh: Mesh, points: Array) -> Array:
    """Signed distance of points to a closed mesh, positive inside. [N, 3] -> [N] float32.

    A point is inside if a ray from it crosses the surface an odd number of times; flaws of the mesh do harm only near them.
    """
    open3d = import_open3d()
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(open3d.core.Tensor(mesh.vertices.astype(np.float32)), open3d.core.Tensor(mesh.faces.astype(np.uint32)))
    return -scene.compute_signed_distance(open3d.core.Tensor(points.astype(np.float32)), nthreads=1).numpy()


def signed_field(mesh: Mesh, grid: Grid) -> Array:
    """Signed distance of a closed mesh on a grid, positive inside. [nx, ny, nz] float32."""

    def distances(points: Array) -> Array:
        return depth_inside(mesh, points)

    # Far from the surface an interpolated coarse grid is good enough, because a distance changes no faster than the position.
    shape = tuple(int(np.ceil((n - 1) / _COARSE)) + 1 for n in grid.shape)
    wide = Grid(grid.origin, grid.spacing * _COARSE, (shape[0], shape[1], shape[2]))
    rough = distances(wide.points()).reshape(wide.shape)
    index = np.stack(np.meshgrid(*(np.arange(n) / _COARSE for n in grid.shape), indexing="ij"))
    field = ndimage.map_coordinates(rough, index, order=1, mode="nearest")
    near = np.abs(field) < 1.1 * np.sqrt(3.0) * wide.spacing
    field[near] = distances(grid.origin + grid.spacing * np.argwhere(near))
    return field.astype(np.float32)


def is_good(mesh: Mesh | None) -> bool:
    """True for a watertight mesh in one piece, oriented outward."""
    if mesh is None or len(mesh.faces) < 4 or not mesh.is_watertight():
        return False
    return mesh.volume() > 0 and len(np.unique(components(mesh))) == 1


def components(mesh: Mesh) -> Array:
    """Label of the connected part that each face belongs to. [F]."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    f = mesh.faces
    rows = np.concatenate([f[:, 0], f[:, 1]])
    columns = np.concatenate([f[:, 1], f[:, 2]])
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(mesh.vertices), len(mesh.vertices)))
    return connected_components(graph, directed=False)[1][f[:, 0]]


def largest_part(mesh: Mesh) -> Mesh:
    """The connected part with the most area, without unused vertices."""
    labels = components(mesh)
    areas = np.bincount(labels, weights=mesh.areas())
    faces = mesh.faces[labels == int(np.argmax(areas))]
    used, index = np.unique(faces, return_inverse=True)
    colours = None if mesh.colours is None else mesh.colours[used]
    return Mesh(mesh.vertices[used], index.reshape(-1, 3).astype(np.int64), colours)


def _isotropic(mesh: Mesh, faces: int) -> Mesh:
    """Even triangles of one size (pymeshlab's isotropic remeshing), about `faces` of them."""
    import pymeshlab

    edge = float(np.sqrt(4.0 * mesh.areas().sum() / (np.sqrt(3.0) * faces)))
    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    work.meshing_isotropic_explicit_remeshing(iterations=6, targetlen=pymeshlab.PureValue(edge), featuredeg=40.0)
    result = work.current_mesh()
    return Mesh(np.array(result.vertex_matrix()), np.array(result.face_matrix()).astype(np.int64))


def _decimated(mesh: Mesh, faces: int) -> Mesh:
    """Quadric decimation (open3d)."""
    open3d = import_open3d()
    work = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(mesh.vertices), open3d.utility.Vector3iVector(mesh.faces.astype(np.int32))
    )
    work = work.simplify_quadric_decimation(target_number_of_triangles=faces)
    return Mesh(np.asarray(work.vertices).copy(), np.asarray(work.triangles).astype(np.int64))


def closed_surface(grid: Grid, field: Array, faces: int) -> Mesh | None:
    """Watertight mesh of a field's zero level in one piece, with at most `faces` faces.

    Args:
        grid, field: Signed distances on a grid, m, positive inside. [nx, ny, nz].
        faces: Face budget.

    Returns:
        An isotropic mesh where that stays watertight; else a decimated one; else marching cubes on a coarser grid, which is
        always closed. None where the field has no inside.
    """
    field = largest_component(field)
    dense = mesh_of_field(grid, field)
    if dense is None:
        return None
    dense = largest_part(dense)
    # The remesher is slow on meshes far finer than its target, and misses its target by some per cent to either side.
    start = _decimated(dense, 4 * faces) if len(dense.faces) > 6 * faces else dense
    start = start if is_good(start) else dense
    for name, make, target in (
        ("isotropic", _isotropic, 0.93),
        ("isotropic", _isotropic, 0.8),
        ("decimated", _decimated, 0.98),
    ):
        mesh = make(start, int(target * faces))
        if is_good(mesh) and len(mesh.faces) <= faces:
            return _seated(mesh)
        logger.info("mesh: the %s mesh (%d faces) is not fit; trying another way", name, len(mesh.faces))
    step = 1.0
    for _ in range(24):
        coarse = Grid.covering(grid.origin, grid.origin + grid.spacing * (np.array(grid.shape) - 1), grid.spacing * step)
        index = (coarse.points() - grid.origin) / grid.spacing
        values = ndimage.map_coordinates(field, index.T, order=1, mode="nearest").reshape(coarse.shape)
        whole = mesh_of_field(coarse, largest_component(values))
        if whole is None:
            return None
        mesh = largest_part(whole)
        if len(mesh.faces) <= faces and is_good(mesh):
            return _seated(mesh)
        step *= 1.15
    return None


def _seated(mesh: Mesh) -> Mesh:
    """The mesh without vertices below the table; the few that the remesher pushed through the table are set onto it."""
    vertices = mesh.vertices.copy()
    vertices[:, 2] = np.maximum(vertices[:, 2], 0.0)
    return Mesh(vertices, mesh.faces, mesh.colours)
