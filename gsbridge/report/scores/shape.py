"""Scores of what a mean distance between surfaces hides: depth of cavities, open holes, missing ends.

A mean distance grows only little if a mug is filled, or if a statue has lost its plinth.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from scipy import ndimage

from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.cavity import cavity_depth

_LEAST_HOLE = 16
"""Smallest hole, pixels: smaller gaps come from a ragged outline."""
WRONG_M = 0.005
"""A mesh that is off by more than this is wrong, m."""
WRONG_IOU = 0.85
"""A mask whose overlap (IoU) with the true one is smaller than this is wrong."""


def shape_scores(name: str, mesh: Mesh, reference: Mesh) -> dict[str, float]:
    """Scores of one mesh of an object.

    Args:
        name: `visual` or `collision`, the beginning of the keys.
        mesh, reference: Estimated and true surface, table frame, m.

    Returns:
        `{name}_extent_mm`: largest displacement of a side of the bounding box, except the side on the table. Where the true
        object has a cavity also `cavity_mm`, its true depth, and `{name}_cavity_error_mm`, found less true.
    """
    sides = [mesh.vertices.min(0)[:2] - reference.vertices.min(0)[:2], mesh.vertices.max(0) - reference.vertices.max(0)]
    out = {f"{name}_extent_mm": 1e3 * float(np.abs(np.concatenate(sides)).max())}
    true = cavity_depth(reference)
    if true > 0:
        out |= {"cavity_mm": 1e3 * true, f"{name}_cavity_error_mm": 1e3 * (cavity_depth(mesh) - true)}
    return out


def hole_pixels(mask: Array) -> Array:
    """Pixels of the holes in a true mask, cut at 0.5. [H, W] -> [H, W] bool."""
    solid = np.asarray(mask) >= 0.5
    labels, count = ndimage.label(ndimage.binary_fill_holes(solid) & ~solid)
    sizes = ndimage.sum_labels(np.ones(labels.shape), labels, np.arange(1, count + 1))
    return np.isin(labels, 1 + np.flatnonzero(np.atleast_1d(sizes) >= _LEAST_HOLE))


def hole_scores(pairs: Iterable[tuple[Array, Array]]) -> dict[str, Any]:
    """Count the pixels of holes in the true masks, and the share of them that the found masks leave open.

    Args:
        pairs: Found and true mask of each view, 0..1. [H, W] each.

    Returns:
        `holes`: pixels of true holes over all views; `holes_found`: share of them that is open, absent without holes.
    """
    total = found = 0
    for mask, true in pairs:
        holes = hole_pixels(true)
        total += int(holes.sum())
        found += int((holes & (np.asarray(mask) < 0.5)).sum())
    return {"holes": total} | ({"holes_found": found / total} if total else {})


def wrong_and_pass(scores: Mapping[str, Any], masks_status: str, mesh_status: str) -> list[str]:
    """List figures of an object that are wrong although its stage says `pass`; empty for right or degraded objects.

    Args:
        scores: Scores of the scene.
        masks_status, mesh_status: What the stages' records say.

    Returns:
        One line for each wrong figure.
    """
    out = []
    if masks_status == "pass" and scores["mask_iou_mean"] < WRONG_IOU:
        out.append(f"mask IoU {scores['mask_iou_mean']:.3f}")
    for key in sorted(scores):
        measured = key.endswith(("_chamfer_mm", "_extent_mm", "_cavity_error_mm"))
        if mesh_status == "pass" and measured and abs(scores[key]) > 1e3 * WRONG_M:
            out.append(f"{key} {scores[key]:.1f}")
    return out
