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


def brightness(mesh: Mesh, targets: Sequence[Target]) -> dict[str, float]:
    """Logarithm of how bright each training photo is beside the others, by the places of a surface that they share.

    Each place has one brightness and each photo one factor; both are medians of what the other leaves, in turns (median polish,
    Tukey 1977), so that highlights and shadows that move count little.

    Args:
        mesh: Surface that the photos show, table frame, m.
        targets: Photos; the held-out ones are not looked at.

    Returns:
        By name of the photo; their median is 0. Photos that show too little of the surface are left out.
    """
    names, rows = [], []
    for target, faces, pixels in shown_faces(mesh, targets):
        light = np.full(len(mesh.faces), np.nan)
        column, row = np.floor(pixels - (target.left, target.top)).astype(int).T
        inside = (column >= 0) & (row >= 0) & (column < target.camera.width) & (row < target.camera.height)
        inside[inside] = target.weight[row[inside], column[inside]] > 250
        seen = linear_from_srgb(target.photo[row[inside], column[inside]].astype(np.float32) / 255)
        usable = (seen.min(1) > _USABLE[0]) & (seen.max(1) < _USABLE[1])
        light[faces[inside][usable]] = np.log(seen[usable].mean(1))
        names.append(target.name)
        rows.append(light)
    table = np.array(rows)
    # A place in a single photo tells nothing.
    table = table[:, np.isfinite(table).sum(0) >= 2]
    enough = np.isfinite(table).sum(1) >= _FEWEST
    if enough.sum() < 2:
        return {}
    table = table[enough]
    table = table[:, np.isfinite(table).sum(0) >= 2]
    factors = np.zeros(len(table))
    for _ in range(_ROUNDS):
        places = np.nanmedian(table - factors[:, None], axis=0)
        factors = np.nanmedian(table - places, axis=1)
        factors -= np.median(factors)
    return dict(zip(np.array(names)[enough].tolist(), factors.tolist(), strict=True))


def spread(logarithms: Sequence[float] | Array) -> float:
    """Standard deviation of photos' logarithmic brightness; 0 of less than two. [N]."""
    values = np.asarray(logarithms, np.float64)
    return float(values.std()) if len(values) > 1 else 0.0
