"""Unmixing of the pixels on an object's outline, which mix the object with the background behind it.

A pixel on the outline is C = a F + (1 - a) B in linear light: a share a of the object's colour F over the background's B. Both
colours are taken from nearby pixels that certainly lie on one side of the outline. A hard mask would make every model wrong in
a ring of one pixel, and put the table's colour on the object's rim.

Source: the model of Chuang et al., "A Bayesian Approach to Digital Matting", CVPR 2001, with one Gaussian per side and a prior
of the share from the distance to the outline.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, srgb_from_linear

BAND_PX = 2.0
"""Pixels nearer to the outline than this are unmixed."""

_REACHES_PX = (2.0, 5.0)
"""Standard deviations of the windows over which the colours of a side are averaged, px: a near one, and a wide one for gaps."""

_OUTLINE_BLUR_PX = 0.7
"""Standard deviation of the blur that turns the mask into the prior of the share, px: half a pixel for the pixel's own area,
half a pixel for the outline's error."""

_SHARE_SIGMA = 0.15
"""Standard deviation of the share that the outline's place alone predicts."""

_NOISE = 0.05
"""Standard deviation of the residual that the two colours do not explain, linear light: noise, and texture finer than the
windows."""


@dataclass(frozen=True)
class Sides:
    """Colours on both sides of an outline, in linear light.

    Args:
        front, back: Mean colours of the object and of the background nearby. [H, W, 3] each.
        front_variance, back_variance: Variances of these colours nearby, mean of the channels. [H, W] each.
    """

    front: Array
    back: Array
    front_variance: Array
    back_variance: Array


def _nearby(colour: Array, sure: Array) -> tuple[Array, Array]:
    """Mean and variance of the colours of sure pixels near each pixel. [H, W, 3], [H, W] bool -> [H, W, 3], [H, W]."""
    mean = np.zeros_like(colour)
    variance = np.full(sure.shape, 0.05, np.float32)
    for reach in reversed(_REACHES_PX):
        count = cv2.GaussianBlur(sure.astype(np.float32), (0, 0), reach)
        total = cv2.GaussianBlur(colour * sure[..., None], (0, 0), reach)
        square = cv2.GaussianBlur((colour**2).mean(-1) * sure, (0, 0), reach)
        known = count > 0.02
        share = np.maximum(count, 1e-6)
        local = total / share[..., None]
        mean = np.where(known[..., None], local, mean)
        variance = np.where(known, np.maximum(square / share - (local**2).mean(-1), 0), variance)
    return mean, variance


def _distance(inside: Array) -> Array:
    """Distance to the outline, px, positive inside. [H, W] bool -> [H, W]."""
    inner = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    outer = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.where(inside, inner - 0.5, 0.5 - outer)


def sides_of(linear: Array, distance: Array) -> Sides:
    """Colours on both sides of an outline. [H, W, 3] linear light, [H, W] px inside."""
    front = _nearby(linear, distance > BAND_PX)
    back = _nearby(linear, distance < -BAND_PX)
    return Sides(front[0], back[0], front[1], back[1])


def estimate_alpha(photo: Array, mask: Array) -> Array:
    """Share of the object in each pixel.

    Args:
        photo: sRGB. [H, W, 3] uint8.
        mask: Mask of the object, 0..1, whose outline is accurate to about a pixel. [H, W].

    Returns:
        1 inside, 0 outside, the share on the outline. [H, W] float32.
    """
    inside = mask > 0.5
    if not inside.any() or inside.all():
        return inside.astype(np.float32)
    part = _around(inside)
    alpha = inside.astype(np.float32)
    distance = _distance(inside)
    prior = cv2.GaussianBlur(inside[part].astype(np.float32), (0, 0), _OUTLINE_BLUR_PX)
    linear = linear_from_srgb(photo[part].astype(np.float32) / 255)
    near = distance[part]
    sides = sides_of(linear, near)
    noise = prior**2 * sides.front_variance + (1 - prior) ** 2 * sides.back_variance + _NOISE**2
    between = sides.front - sides.back
    evidence = ((linear - sides.back) * between).sum(-1) / noise
    certainty = (between**2).sum(-1) / noise
    share = (evidence + prior / _SHARE_SIGMA**2) / (certainty + 1 / _SHARE_SIGMA**2)
    alpha[part] = np.where(np.abs(near) < BAND_PX, np.clip(share, 0, 1), alpha[part])
    return alpha


def unmix(photo: Array, alpha: Array) -> Array:
    """The object's own colour in each pixel: on the outline, the colour without the background's share.

    Args:
        photo: sRGB. [H, W, 3] uint8.
        alpha: Share of the object, 0..1. [H, W].

    Returns:
        sRGB; pixels with a share of 0 or 1 keep the photo's colour. [H, W, 3] uint8.
    """
    mixed = (alpha > 0) & (alpha < 1)
    if not mixed.any():
        return photo
    part = _around(alpha > 0)
    linear = linear_from_srgb(photo[part].astype(np.float32) / 255)
    share = alpha[part].astype(np.float32)
    sides = sides_of(linear, _distance(share > 0.5))
    # The most probable colour, with the side's mean colour as prior; the background's texture counts as noise.
    rest = linear - share[..., None] * sides.front - (1 - share[..., None]) * sides.back
    noise = (1 - share) ** 2 * sides.back_variance + _NOISE**2
    gain = share * sides.front_variance / (share**2 * sides.front_variance + noise)
    colour = sides.front + gain[..., None] * rest
    out = photo.copy()
    shown = np.rint(255 * srgb_from_linear(np.clip(colour, 0, 1))).astype(np.uint8)
    out[part] = np.where(mixed[part][..., None], shown, photo[part])
    return out


def background_of(photo: Array, alpha: Array) -> Array:
    """Background behind the object's rim: beside the object the photo itself, on the outline the background's colour nearby.

    Args:
        photo: sRGB. [H, W, 3] uint8.
        alpha: Share of the object, 0..1. [H, W].

    Returns:
        Linear light; black deep inside the object, where the background is unknown. [H, W, 3] float32.
    """
    linear = linear_from_srgb(photo.astype(np.float32) / 255)
    if not (alpha > 0).any():
        return linear
    back = sides_of(linear, _distance(alpha > 0.5)).back
    return np.where((alpha > 0)[..., None], back, linear)


def _around(inside: Array) -> tuple[slice, slice]:
    """Slices of the bounding box of true pixels with room for the windows."""
    margin = int(3 * _REACHES_PX[-1] + BAND_PX)
    rows, columns = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
    return (
        slice(max(0, rows[0] - margin), rows[-1] + 1 + margin),
        slice(max(0, columns[0] - margin), columns[-1] + 1 + margin),
    )
