"""Colours of splats as one camera sees them: spherical harmonics at the direction to each splat, and their gradients.

Rasterisers take one colour per splat; these functions compute it before, once per picture. Source and convention:
`splats.harmonics`.
"""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

import math
from typing import Any

import numpy as np
import torch

from gsbridge.geometry import Array
from gsbridge.splats import harmonics as functions
from gsbridge.splats.rasterize import layout
from gsbridge.splats.rasterize.lanes import WIDTH, larger, select, square_root
from gsbridge.splats.rasterize.memory import at, load, store

_first, _second, _third = njit(functions.first), njit(functions.second), njit(functions.third)
_first_slopes, _second_slopes = njit(functions.first_slopes), njit(functions.second_slopes)
_third_slopes = njit(functions.third_slopes)

_NEAREST2 = 1e-24
"""Squared distance from the camera below which the direction to a splat is undefined, m^2."""


@njit(error_model="numpy")
def _basis(x: float, y: float, z: float, terms: int, values: Array) -> None:
    """Fill `values` with the first `terms` functions of a unit vector. [K]."""
    values[0], values[1], values[2] = _first(x, y, z)
    if terms > 3:
        values[3], values[4], values[5], values[6], values[7] = _second(x, y, z)
    if terms > 8:
        values[8], values[9], values[10], values[11], values[12], values[13], values[14] = _third(x, y, z)


@njit(error_model="numpy")
def _fill(slopes: Array, start: int, values: tuple[float, ...]) -> None:
    for k in range(len(values)):
        slopes[(start + k) // 3, (start + k) % 3] = values[k]


@njit(error_model="numpy")
def view(means: Array, colours: Array, harmonics: Array, eye: Array, out: Array) -> None:
    """Compute colours as seen from a point.

    Args:
        means, colours: Centres, m, and the constant part of the colours. [N, 3] each.
        harmonics: Coefficients of the part that depends on direction; K is at least 3. [N, K, 3].
        eye: Position of the camera, in the frame of the means, m. [3].
        out: Filled with the colours. [N, 3].
    """
    terms = harmonics.shape[1]
    values = np.empty(15, means.dtype)
    for i in range(means.shape[0]):
        dx, dy, dz = means[i, 0] - eye[0], means[i, 1] - eye[1], means[i, 2] - eye[2]
        share = 1.0 / math.sqrt(max(dx * dx + dy * dy + dz * dz, _NEAREST2))
        _basis(dx * share, dy * share, dz * share, terms, values)
        for c in range(3):
            colour = colours[i, c]
            for k in range(terms):
                colour += values[k] * harmonics[i, k, c]
            # This form lets NaN pass, so that the rasteriser leaves the splat out.
            out[i, c] = 0.0 if colour < 0.0 else colour


@njit(error_model="numpy")
def view_backward(
    means: Array,
    harmonics: Array,
    eye: Array,
    seen: Array,
    upstream: Array,
    g_means: Array,
    g_colours: Array,
    g_harmonics: Array,
) -> None:
    """Compute the gradients through `view`.

    Args:
        means, harmonics, eye: As in `view`. [N, 3], [N, K, 3], [3].
        seen: Output of `view`. [N, 3].
        upstream: Gradient of the loss with respect to `seen`. [N, 3].
        g_means, g_colours, g_harmonics: Filled; must be zero on entry. [N, 3], [N, 3], [N, K, 3].
    """
    terms = harmonics.shape[1]
    values, slopes = np.empty(15, means.dtype), np.empty((15, 3), means.dtype)
    for i in range(means.shape[0]):
        if upstream[i, 0] == 0.0 and upstream[i, 1] == 0.0 and upstream[i, 2] == 0.0:
            continue
        dx, dy, dz = means[i, 0] - eye[0], means[i, 1] - eye[1], means[i, 2] - eye[2]
        share = 1.0 / math.sqrt(max(dx * dx + dy * dy + dz * dz, _NEAREST2))
        x, y, z = dx * share, dy * share, dz * share
        _basis(x, y, z, terms, values)
        _fill(slopes, 0, _first_slopes(x, y, z))
        if terms > 3:
            _fill(slopes, 9, _second_slopes(x, y, z))
        if terms > 8:
            _fill(slopes, 24, _third_slopes(x, y, z))
        gx, gy, gz = 0.0, 0.0, 0.0
        for c in range(3):
            # A colour that is clamped at 0 has no gradient.
            if not seen[i, c] > 0.0:
                continue
            g = upstream[i, c]
            g_colours[i, c] = g
            for k in range(terms):
                g_harmonics[i, k, c] = g * values[k]
                weight = g * harmonics[i, k, c]
                gx, gy, gz = gx + weight * slopes[k, 0], gy + weight * slopes[k, 1], gz + weight * slopes[k, 2]
        # A unit vector changes only perpendicular to itself, so remove the gradient's component along it.
        along = gx * x + gy * y + gz * z
        gx, gy, gz = gx - along * x, gy - along * y, gz - along * z
        g_means[i, 0], g_means[i, 1], g_means[i, 2] = gx * share, gy * share, gz * share


class _View(torch.autograd.Function):
    """Autograd wrapper of the kernels, in float32 or float64."""

    @staticmethod
    def forward(ctx: Any, means: torch.Tensor, colours: torch.Tensor, harmonics: torch.Tensor, eye: Array) -> torch.Tensor:
        places, constant, rest = (tensor.detach().contiguous().numpy() for tensor in (means, colours, harmonics))
        out = np.empty_like(constant)
        view(places, constant, rest, eye, out)
        ctx.state = (places, rest, eye, out)
        return torch.from_numpy(out)

    @staticmethod
    def backward(ctx: Any, upstream: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        means, harmonics, eye, seen = ctx.state
        out = np.zeros_like(means), np.zeros_like(seen), np.zeros_like(harmonics)
        view_backward(means, harmonics, eye, seen, upstream.contiguous().numpy(), *out)
        return (*(torch.from_numpy(array) for array in out), None)


def view_colours(
    means: torch.Tensor, colours: torch.Tensor, harmonics: torch.Tensor, eye: Array, *, kernels: bool = True
) -> torch.Tensor:
    """Return the colours of splats as a camera sees them, differentiable in all three tensors.

    Args:
        means: Centres, m. [N, 3].
        colours: Constant part of the colours. [N, 3].
        harmonics: Coefficients of the part that depends on direction. [N, K, 3].
        eye: Position of the camera, in the frame of the means, m. [3].
        kernels: True for the compiled kernels, on the CPU; False for plain torch, on any device.

    Returns:
        Colours, not below 0; `colours` itself if there are no harmonics. [N, 3].
    """
    degree = functions.degree_of(harmonics.shape[1])
    if degree == 0:
        return colours
    if kernels:
        seen: torch.Tensor = _View.apply(means, colours, harmonics, np.asarray(eye, dtype=means.detach().numpy().dtype))
        return seen
    offsets = means - torch.as_tensor(np.asarray(eye), dtype=means.dtype, device=means.device)
    x, y, z = torch.nn.functional.normalize(offsets, dim=-1).unbind(-1)
    values = torch.stack(functions.basis(x, y, z, degree), dim=-1)
    return torch.clamp_min(colours + (values[:, None] @ harmonics)[:, 0], 0.0)


def viewed(means: Array, colours: Array, harmonics: Array, eye: Array) -> Array:
    """Do the work of `view_colours` for float32 arrays, without gradients.

    Args:
        means, colours, harmonics, eye: As in `view_colours`. [N, 3], [N, 3], [N, K, 3], [3].
    """
    if harmonics.shape[1] == 0:
        return colours
    out = np.empty_like(colours)
    view(means, colours, harmonics, np.asarray(eye, dtype=np.float32), out)
    return out


def packed(colours: Array, harmonics: Array) -> Array:
    """Interleave constant colours and harmonics of a multiple of `WIDTH` splats as `view_groups` reads them.

    [N, 3], [N, K, 3] -> [N * (1 + K) * 3] float32.
    """
    rows = np.concatenate([colours[:, None], harmonics], axis=1).astype(np.float32)
    return np.ascontiguousarray(rows.reshape(-1, WIDTH, *rows.shape[1:]).transpose(0, 2, 3, 1)).reshape(-1)


@njit(error_model="numpy")
def view_groups(packed: Array, terms: int, count: int, groups: Array, owners: Array, views: Array, lanes: Array) -> None:
    """Write the colours of some groups of splats, as a camera sees them, into the input of the projection, eight at a time.

    Args:
        packed: Output of the function `packed`. [N * (1 + terms) * 3].
        terms: Number of harmonics of each splat, without the constant one.
        count: Number of splats.
        groups, owners, views: As in `gsbridge.splats.rasterize.projection.project`. [G], [G], [F * 16].
        lanes: Prepared splats; the colours of these groups are replaced. [N * `LANES`].
    """
    scratch = np.empty(15 * WIDTH, np.float32)
    for place in range(groups.shape[0]):
        v = 16 * owners[place]
        t0, t1, t2 = at(views, v + 13), at(views, v + 14), at(views, v + 15)
        # Position of the camera in the frame of the splats: -R^T t.
        ex = -(at(views, v + 4) * t0 + at(views, v + 7) * t1 + at(views, v + 10) * t2)
        ey = -(at(views, v + 5) * t0 + at(views, v + 8) * t1 + at(views, v + 11) * t2)
        ez = -(at(views, v + 6) * t0 + at(views, v + 9) * t1 + at(views, v + 12) * t2)
        for pack in range(layout.GROUP // WIDTH):
            number = groups[place] * layout.GROUP + pack * WIDTH
            if number >= count:
                continue
            start, base = number * layout.LANES, number * (1 + terms) * 3
            dx, dy, dz = load(lanes, start) - ex, load(lanes, start + WIDTH) - ey, load(lanes, start + 2 * WIDTH) - ez
            share = 1.0 / square_root(larger(dx * dx + dy * dy + dz * dz, _NEAREST2))
            x, y, z = dx * share, dy * share, dz * share
            b0, b1, b2 = _first(x, y, z)
            store(scratch, 0, b0)
            store(scratch, WIDTH, b1)
            store(scratch, 2 * WIDTH, b2)
            if terms > 3:
                b0, b1, b2, b3, b4 = _second(x, y, z)
                store(scratch, 3 * WIDTH, b0)
                store(scratch, 4 * WIDTH, b1)
                store(scratch, 5 * WIDTH, b2)
                store(scratch, 6 * WIDTH, b3)
                store(scratch, 7 * WIDTH, b4)
            if terms > 8:
                b0, b1, b2, b3, b4, b5, b6 = _third(x, y, z)
                store(scratch, 8 * WIDTH, b0)
                store(scratch, 9 * WIDTH, b1)
                store(scratch, 10 * WIDTH, b2)
                store(scratch, 11 * WIDTH, b3)
                store(scratch, 12 * WIDTH, b4)
                store(scratch, 13 * WIDTH, b5)
                store(scratch, 14 * WIDTH, b6)
            red, green, blue = load(packed, base), load(packed, base + WIDTH), load(packed, base + 2 * WIDTH)
            for k in range(terms):
                value, row = load(scratch, k * WIDTH), base + (k + 1) * 3 * WIDTH
                red = red + value * load(packed, row)
                green = green + value * load(packed, row + WIDTH)
                blue = blue + value * load(packed, row + 2 * WIDTH)
            store(lanes, start + 11 * WIDTH, select(red < 0.0, 0.0, red))
            store(lanes, start + 12 * WIDTH, select(green < 0.0, 0.0, green))
            store(lanes, start + 13 * WIDTH, select(blue < 0.0, 0.0, blue))
