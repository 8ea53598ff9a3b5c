"""Relative brightness of photos: surface points seen in several photos show whether the camera changed its exposure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb
from gsbridge.meshes import Mesh
from gsbridge.splats.targets import Target, shown_faces

NOTICEABLE = 0.05
"""Standard deviation of the photos' logarithmic brightness above which `exposure: auto` fits an exposure to each photo. A grey
with such an error limits the PSNR to 40 dB, as noise does; an unnecessary fit costs next to nothing (docs/splats.md)."""

_USABLE = 0.005, 0.9
"""Range of linear light that is neither lost in noise nor close to the camera's clipping."""
_FEWEST = 30
"""Smallest number of surface points from which a photo's brightness is estimated."""
_ROUNDS = 20


def brightness(mesh: Mesh, targets: Sequence[Target]) -> dict[str, Array]:
    """Estimate the relative brightness of the training photos from the surface points that they share.

    The model has one brightness per surface point and one factor per photo. Both are fitted in turns as medians of the residual
    (median polish, Tukey 1977), so that moving highlights and shadows have little influence.

    Args:
        mesh: Surface that the photos show, table frame, m.
        targets: Photos; held-out photos are not used.

    Returns:
        By photo name, the natural logarithms of the factors of red, green and blue; the median over the photos is 0 for each
        colour. Photos that show too few usable points are left out. [3] each.
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
    # A point seen in a single photo gives no information.
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
    """Return the standard deviation of logarithmic brightness over photos, of the colour where it is largest. [N][3].

    It is 0 for fewer than two photos.
    """
    return float(np.std(logarithms, axis=0).max()) if len(logarithms) > 1 else 0.0
