"""Convex pieces for contact: a decomposition of the true objects, cached on disk, and sectors cut from the plate."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from gsbridge.digests import code_digest
from gsbridge.errors import InputError
from gsbridge.files import atomic_file, versions
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh

CONCAVITY = 0.003
"""Depth up to which dents are filled, m."""

MOST = 16
"""Largest number of pieces of one object."""

FOOT = 5e-5
"""Distance within which vertices are moved to z = 0, m: objects have flat feet, but the decomposition shifts them."""

_SEARCH = 60


def convex_pieces(mesh: Mesh, folder: str | Path) -> list[Array]:
    """Return convex pieces that together fill a closed mesh, from a cache if possible.

    The cache's key is a hash of the mesh, of this module's code and of the version of `coacd`.

    Args:
        mesh: Watertight mesh that stands on z = 0, m.
        folder: Folder of the cache.

    Returns:
        Vertices of each piece, m. [N, 3] each.

    Raises:
        InputError: The mesh is not watertight.

    Source: Wei et al., "Approximate convex decomposition for 3D meshes with collision-aware concavity and tree search", 2022.
    """
    if not mesh.is_watertight():
        raise InputError("mirror", "an object's mesh is not watertight", "Mesh its shape again")
    key = hashlib.sha256(repr((code_digest(__name__), versions("coacd"))).encode())
    for part in (mesh.vertices.astype("<f8"), mesh.faces.astype("<i8")):
        key.update(np.ascontiguousarray(part).tobytes())
    path = Path(folder) / f"pieces-{key.hexdigest()[:16]}.npz"
    if not path.is_file():
        pieces = _decompose(mesh)
        with atomic_file(path) as temporary:
            np.savez(temporary, points=np.concatenate(pieces), counts=[len(piece) for piece in pieces])
    with np.load(path) as stored:
        return np.split(stored["points"], np.cumsum(stored["counts"])[:-1])


def _decompose(mesh: Mesh) -> list[Array]:
    """Decompose a closed mesh with a flat foot."""
    import coacd

    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces.astype(np.int32)),
        threshold=CONCAVITY,
        real_metric=True,
        max_convex_hull=MOST,
        mcts_iterations=_SEARCH,
        preprocess_mode="off",  # the mesh is closed already, and resampling would move its foot
        seed=0,
    )
    pieces = [np.array(vertices, dtype=np.float64) for vertices, _ in parts]
    for piece in pieces:
        piece[np.abs(piece[:, 2]) < FOOT, 2] = 0.0
    return pieces


def plate_pieces(mesh: Mesh, radii: tuple[float, ...] = (0.048, 0.063, 0.081), sectors: int = 32) -> list[Array]:
    """Cut a plate into convex pieces: a disc, and rings around it cut into sectors.

    A decomposition by search would fill the plate's well or take minutes; for a body of revolution it is not needed. With 32
    sectors, the chords differ from the rim's circle by at most 0.5 mm.

    Args:
        mesh: The plate, own frame, m; its vertices are no farther apart than 2 mm.
        radii: Outer radius of the disc, and of each ring but the last, m; the profile is nearly straight between them.
        sectors: Number of sectors of a ring.

    Returns:
        Vertices of each piece, m. [N, 3] each.
    """
    rho = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    # Neighbouring pieces overlap by the width of a cell of the mesh, so that no gap opens between them.
    reach = 2e-3
    turn = np.pi / sectors + 0.5 * reach / radii[-1]
    pieces = [mesh.vertices[rho <= radii[0] + reach]]
    for low, high in zip(radii, (*radii[1:], np.inf), strict=True):
        ring = (rho >= low - reach) & (rho <= high + reach)
        for sector in range(sectors):
            off = np.angle(np.exp(1j * (angle - 2 * np.pi * (sector + 0.5) / sectors)))
            pieces.append(mesh.vertices[ring & (np.abs(off) <= turn)])
    return pieces
