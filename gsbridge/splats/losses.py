"""The training loss: L1 and structural similarity, value and gradient from one pass of compiled kernels.

SSIM with a Gaussian window of 11x11 px and sigma 1.5, images 0..1, zero beyond the border, as 3D Gaussian splatting trains. The
window is separable, and colours may stay interleaved: along a row the taps are three values apart.

Source: Wang et al., "Image quality assessment: from error visibility to structural similarity", 2004.
"""

from __future__ import annotations

from gsbridge.kernels import njit, prange  # isort: skip  (first: it sets numba's cache folder)

from typing import Any

import numpy as np
import torch

from gsbridge import logs
from gsbridge.geometry import Array
from gsbridge.splats.rasterize.blending import use_threads
from gsbridge.splats.rasterize.lanes import WIDTH, load, select, spread, store

RADIUS = 5
SIGMA_PX = 1.5
C1, C2 = 0.01**2, 0.03**2
_STEP = 3
_PAD = 16
"""Zeros before and after a row, at least `RADIUS * _STEP`."""
_ROWS = 2 * RADIUS + 1


def window() -> Array:
    """One axis of the window, centre first: taps at distance 0..5 px. [6]."""
    distance = np.arange(RADIUS + 1)
    taps = np.exp(-0.5 * (distance / SIGMA_PX) ** 2)
    return (taps / (taps[0] + 2.0 * taps[1:].sum())).astype(np.float32)


W0, W1, W2, W3, W4, W5 = (float(tap) for tap in window())


@njit(error_model="numpy", forceinline=True)
def _blur_along(row, at):
    """Window along a padded, interleaved row, for eight values from `at` on."""
    out = W0 * load(row, at) + W1 * (load(row, at - 3) + load(row, at + 3))
    out = out + W2 * (load(row, at - 6) + load(row, at + 6)) + W3 * (load(row, at - 9) + load(row, at + 9))
    return out + W4 * (load(row, at - 12) + load(row, at + 12)) + W5 * (load(row, at - 15) + load(row, at + 15))


@njit(error_model="numpy", forceinline=True)
def _blur_across(ring, rows, at):
    """Window across eleven rows of the ring, `rows` holding their starts from the top."""
    out = W0 * load(ring, rows[5] + at) + W1 * (load(ring, rows[4] + at) + load(ring, rows[6] + at))
    out = out + W2 * (load(ring, rows[3] + at) + load(ring, rows[7] + at))
    out = out + W3 * (load(ring, rows[2] + at) + load(ring, rows[8] + at))
    out = out + W4 * (load(ring, rows[1] + at) + load(ring, rows[9] + at))
    return out + W5 * (load(ring, rows[0] + at) + load(ring, rows[10] + at))


@njit(error_model="numpy", forceinline=True)
def _size(values):
    return select(values < 0.0, -values, values)


@njit(error_model="numpy")
def _compare_band(
    image, target, weights, first, last, height, length, stride, l1_factor, ssim_factor, maps, gradient, l1, ssim
):
    """Compare rows first..last: fill the rows' sums, the L1 gradient and the three maps that `_gather_band` blurs back."""
    padded = np.zeros(5 * (stride + 2 * _PAD), np.float32)
    span = stride + 2 * _PAD
    ring = np.zeros(_ROWS * 5 * stride, np.float32)
    rows = np.zeros(_ROWS, np.int64)
    one_l1, one_ssim, weight_row = np.zeros(stride, np.float32), np.zeros(stride, np.float32), np.zeros(stride, np.float32)
    l1_row = np.zeros(stride, np.float32)
    pixels_x, pixels_y = np.zeros(stride, np.float32), np.zeros(stride, np.float32)
    for row in range(first - RADIUS, last + RADIUS):
        slot = (row + _ROWS) % _ROWS * 5 * stride
        if 0 <= row < height:
            for i in range(length):
                x, y = image[row * length + i], target[row * length + i]
                padded[_PAD + i] = x
                padded[span + _PAD + i] = y
                padded[2 * span + _PAD + i] = x * x
                padded[3 * span + _PAD + i] = y * y
                padded[4 * span + _PAD + i] = x * y
            for quantity in range(5):
                for i in range(0, stride, WIDTH):
                    store(ring, slot + quantity * stride + i, _blur_along(padded, quantity * span + _PAD + i))
        else:
            ring[slot : slot + 5 * stride] = 0.0
        out = row - RADIUS
        if out < first:
            continue
        for k in range(_ROWS):
            rows[k] = (out - RADIUS + k + _ROWS) % _ROWS * 5 * stride
        for i in range(length):
            weight_row[i] = weights[out * length // 3 + i // 3]
            pixels_x[i], pixels_y[i] = image[out * length + i], target[out * length + i]
        for i in range(0, stride, WIDTH):
            mx, my = _blur_across(ring, rows, i), _blur_across(ring, rows, stride + i)
            xx, yy = _blur_across(ring, rows, 2 * stride + i), _blur_across(ring, rows, 3 * stride + i)
            xy = _blur_across(ring, rows, 4 * stride + i)
            weight = load(weight_row, i)
            a1, a2 = 2.0 * mx * my + C1, 2.0 * (xy - mx * my) + C2
            mean2 = mx * mx + my * my
            b1, b2 = mean2 + C1, xx + yy - mean2 + C2
            r1, r2 = 1.0 / b1, 1.0 / b2
            both = r1 * r2
            value = a1 * a2 * both
            scale = weight * ssim_factor
            at = out * stride + i
            store(maps, at, scale * 2.0 * (my * (a2 - a1) * both - value * mx * (r1 - r2)))
            store(maps, height * stride + at, -(scale * value * r2))
            store(maps, 2 * height * stride + at, scale * 2.0 * a1 * both)
            difference = load(pixels_x, i) - load(pixels_y, i)
            store(one_ssim, i, weight * value)
            store(one_l1, i, weight * _size(difference))
            slope = weight * l1_factor
            store(l1_row, i, select(difference > 0.0, slope, select(difference < 0.0, -slope, spread(0.0))))
        total_l1, total_ssim = 0.0, 0.0
        for i in range(length):
            total_l1 += one_l1[i]
            total_ssim += one_ssim[i]
            gradient[out * length + i] = l1_row[i]
        l1[out], ssim[out] = total_l1, total_ssim


@njit(error_model="numpy")
def _gather_band(image, target, first, last, height, length, stride, maps, gradient):
    """Blur the three maps back (the window is symmetric) and add them to the gradient of rows first..last."""
    span = stride + 2 * _PAD
    padded = np.zeros(3 * span, np.float32)
    ring = np.zeros(_ROWS * 3 * stride, np.float32)
    rows = np.zeros(_ROWS, np.int64)
    result = np.zeros(3 * stride, np.float32)
    for row in range(first - RADIUS, last + RADIUS):
        slot = (row + _ROWS) % _ROWS * 3 * stride
        if 0 <= row < height:
            for quantity in range(3):
                base = (quantity * height + row) * stride
                padded[quantity * span + _PAD : quantity * span + _PAD + length] = maps[base : base + length]
                for i in range(0, stride, WIDTH):
                    store(ring, slot + quantity * stride + i, _blur_along(padded, quantity * span + _PAD + i))
        else:
            ring[slot : slot + 3 * stride] = 0.0
        out = row - RADIUS
        if out < first:
            continue
        for k in range(_ROWS):
            rows[k] = (out - RADIUS + k + _ROWS) % _ROWS * 3 * stride
        for i in range(0, stride, WIDTH):
            for quantity in range(3):
                store(result, quantity * stride + i, _blur_across(ring, rows, quantity * stride + i))
        for i in range(length):
            at = out * length + i
            gradient[at] += result[i] + 2.0 * image[at] * result[stride + i] + target[at] * result[2 * stride + i]


@njit(error_model="numpy")
def _compare(image, target, weights, height, length, stride, l1_factor, ssim_factor, with_gradient, maps, gradient, l1, ssim):
    """Loss and gradient on one thread."""
    _compare_band(image, target, weights, 0, height, height, length, stride, l1_factor, ssim_factor, maps, gradient, l1, ssim)
    if with_gradient:
        _gather_band(image, target, 0, height, height, length, stride, maps, gradient)


@njit(error_model="numpy", parallel=True)
def _compare_parallel(
    image, target, weights, height, length, stride, l1_factor, ssim_factor, with_gradient, maps, gradient, l1, ssim, bands
):
    """`_compare` in bands of rows; every row is computed in the same way, so the result is the same to the last bit."""
    for band in prange(bands):
        first, last = height * band // bands, height * (band + 1) // bands
        _compare_band(
            image, target, weights, first, last, height, length, stride, l1_factor, ssim_factor, maps, gradient, l1, ssim
        )
    if with_gradient:
        for band in prange(bands):
            first, last = height * band // bands, height * (band + 1) // bands
            _gather_band(image, target, first, last, height, length, stride, maps, gradient)


def _evaluate(
    image: Array, target: Array, weights: Array | None, ssim_weight: float, gradient: bool
) -> tuple[float, float, Array]:
    """Weighted mean of L1 and SSIM, and the gradient of the mixed loss. [H, W, 3] -> float, float, [H, W, 3]."""
    height, width = image.shape[:2]
    weights = np.ones(height * width, np.float32) if weights is None else weights
    total = 3.0 * float(weights.sum(dtype=np.float64))
    share = 1.0 / total if total > 0.0 else 0.0
    length = 3 * width
    stride = -(-length // WIDTH) * WIDTH
    out, maps = np.empty(height * length, np.float32), np.empty(3 * height * stride, np.float32)
    l1, ssim = np.empty(height), np.empty(height)
    factors = np.float32((1.0 - ssim_weight) * share), np.float32(-ssim_weight * share)
    arguments = (
        image.reshape(-1),
        target.reshape(-1),
        weights,
        height,
        length,
        stride,
        *factors,
        gradient,
        maps,
        out,
        l1,
        ssim,
    )
    if logs.threads() > 1:
        use_threads(logs.threads())
        _compare_parallel(*arguments, logs.threads())
    else:
        _compare(*arguments)
    return float(l1.sum()) * share, float(ssim.sum()) * share, out.reshape(image.shape)


class _L1Ssim(torch.autograd.Function):
    """Autograd around the kernels: the gradient is ready after the forward pass and only scaled in the backward pass."""

    @staticmethod
    def forward(ctx: Any, image, target, weight, ssim_weight: float):  # type: ignore[no-untyped-def]
        arrays = [np.ascontiguousarray(tensor.detach().numpy(), dtype=np.float32) for tensor in (image, target)]
        weights = None if weight is None else np.ascontiguousarray(weight.detach().numpy(), dtype=np.float32).reshape(-1)
        l1, ssim, gradient = _evaluate(*arrays, weights, ssim_weight, ctx.needs_input_grad[0])
        ctx.gradient = torch.from_numpy(gradient)
        inside = 1.0 if weights is None or weights.any() else 0.0
        return image.new_tensor((1.0 - ssim_weight) * l1 + ssim_weight * (inside - ssim))

    @staticmethod
    def backward(ctx: Any, upstream):  # type: ignore[no-untyped-def]
        return upstream * ctx.gradient, None, None, None


def l1_ssim(
    image: torch.Tensor, target: torch.Tensor, weight: torch.Tensor | None = None, ssim_weight: float = 0.2
) -> torch.Tensor:
    """`(1 - s) mean |image - target| + s (1 - mean SSIM)`, differentiable in `image`.

    Args:
        image: Rendered RGB 0..1. [H, W, 3].
        target: Photo. [H, W, 3].
        weight: Weight of each pixel in both means, not negative; all equal when None. [H, W].
        ssim_weight: s, 0..1.

    Returns:
        The loss, a scalar; 0 where all weights are 0.

    Raises:
        ValueError: The shapes do not fit together.
    """
    if image.ndim != 3 or image.shape[-1] != 3 or image.shape != target.shape:
        raise ValueError(f"image {tuple(image.shape)} and target {tuple(target.shape)} must both be [H, W, 3]")
    if weight is not None and weight.shape != image.shape[:2]:
        raise ValueError(f"weight has shape {tuple(weight.shape)}, expected {tuple(image.shape[:2])}")
    return _L1Ssim.apply(image, target, weight, ssim_weight)  # type: ignore[no-any-return]
