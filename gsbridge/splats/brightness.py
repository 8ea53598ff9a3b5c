"""How bright photos are beside one another: the same places of a surface, seen in several, tell a camera that re-exposed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb
from gsbridge.meshes import Mesh
from gsbridge.splats.targets import Target, shown_faces

NOTICEABLE = 0.05
"""Standard deviation of photos' logarithmic brightness from which `exposure: auto` fits each photo's own. A grey that is off by
so much limits the PSNR to 40 dB, as noise does; a fit that was not needed costs next to nothing (docs/splats.md)."""

_USABLE = 0.005, 0.9
"""Linear light that is neither lost in noise nor near where a camera clips."""
_FEWEST = 30
"""Places from which a photo's brightness is told."""
_ROUNDS = 20


def brightness(mesh: Mesh, targets: Sequence[Target]) -> dict[str, Array]:
    """Logarithms of how bright red, green and blue of each training photo are beside the others', by the places of a surface
    that they share.

    Each place has one brightness and each photo one factor; both are medians of what the other leaves, in turns (median polish,
    Tukey 1977), so that highlights and shadows that move count little.

    Args:
        mesh: Surface that the photos show, table frame, m.
        targets: Photos; the held-out ones are not looked at.

    Returns:
        By name of the photo; the median of each colour is 0. Photos that show too little of the surface are left out. [3].
    """
    names, rows = [], []
    for target, faces, pixels in shown_faces(mesh, targets):
        light = np.full((len(mesh.faces), 3), np.nan)
        column, row = np.floor(pixels - (target.left, target.top)).astype(int).T
        inside = (column >= 0) & (row >= 0) & (column < target.camera.width) & (row < target.camera.height)
        inside[inside] = target.weight[row[inside], column[inside]] > 250
        seen = linear_from_srgb(target.photo[row[inside], column[inside]].astype(np.float32) / 255)
        usable = (seen.min(1) > _USABLE[0]) & (seen.max(1) < _USABLE[1])
        light[faces[inside][usable]] = np.log(seen[usable])
        names.append(target.name)
        rows.append(light)
    table = np.array(rows)
    # A place in a single photo tells nothing.
    table = table[:, np.isfinite(table[..., 0]).sum(0) >= 2]
    enough = np.isfinite(table[..., 0]).sum(1) >= _FEWEST
    if enough.sum() < 2:
        return {}
    table = table[enough]
    table = table[:, np.isfinite(table[..., 0]).sum(0) >= 2]
    factors = np.zeros((len(table), 3))
    for _ in range(_ROUNDS):
        places = np.nanmedian(table - factors[:, None], axis=0)
        factors = np.nanmedian(table - places, axis=1)
        factors -= np.median(factors, axis=0)
    return dict(zip(np.array(names)[enough].tolist(), factors, strict=True))


def spread(logarithms: Sequence[Array]) -> float:
    """Standard deviation of photos' logarithmic brightness in the colour that differs most; 0 of less than two. [N][3]."""
    return float(np.std(logarithms, axis=0).max()) if len(logarithms) > 1 else 0.0
