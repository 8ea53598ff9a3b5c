"""The training loss: L1 and structural similarity (SSIM), with value and gradient from one pass of compiled kernels.

SSIM uses a Gaussian window of 11x11 px with sigma 1.5 on images 0..1, which are zero beyond the border, as in the training of
3D Gaussian splatting. The window is separable. Colours stay interleaved: along a row the taps are three values apart.

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
from gsbridge.splats.rasterize.lanes import WIDTH, LaneValues, select, spread
from gsbridge.splats.rasterize.memory import load, load_spread, store

RADIUS = 5
SIGMA_PX = 1.5
C1, C2 = 0.01**2, 0.03**2
_STEP = 3
_PAD = 16
"""Number of zeros before and after a row, at least `RADIUS * _STEP`."""
_ROWS = 2 * RADIUS + 1


def window() -> Array:
    """Return one axis of the window, centre first: the taps at distances 0..5 px. [6]."""
    distance = np.arange(RADIUS + 1)
    taps = np.exp(-0.5 * (distance / SIGMA_PX) ** 2)
    return (taps / (taps[0] + 2.0 * taps[1:].sum())).astype(np.float32)


TAPS = window()


@njit(error_model="numpy")
def _blur_along(taps: Array, source: Array, start: int, target: Array, to: int, stride: int) -> None:
    """Apply the window along a padded, interleaved row."""
    w0, w1, w2 = load_spread(taps, 0), load_spread(taps, 1), load_spread(taps, 2)
    w3, w4, w5 = load_spread(taps, 3), load_spread(taps, 4), load_spread(taps, 5)
    for i in range(0, stride, WIDTH):
        at = start + i
        out = w0 * load(source, at) + w1 * (load(source, at - 3) + load(source, at + 3))
        out = out + w2 * (load(source, at - 6) + load(source, at + 6)) + w3 * (load(source, at - 9) + load(source, at + 9))
        out = out + w4 * (load(source, at - 12) + load(source, at + 12)) + w5 * (load(source, at - 15) + load(source, at + 15))
        store(target, to + i, out)


@njit(error_model="numpy")
def _blur_across(taps: Array, ring: Array, rows: Array, offset: int, target: Array, to: int, stride: int) -> None:
    """Apply the window across eleven rows of the ring buffer; `rows` holds their start indices, topmost first."""
    w0, w1, w2 = load_spread(taps, 0), load_spread(taps, 1), load_spread(taps, 2)
    w3, w4, w5 = load_spread(taps, 3), load_spread(taps, 4), load_spread(taps, 5)
    a5, a4, a3, a2, a1 = rows[0] + offset, rows[1] + offset, rows[2] + offset, rows[3] + offset, rows[4] + offset
    b1, b2, b3, b4, b5 = rows[6] + offset, rows[7] + offset, rows[8] + offset, rows[9] + offset, rows[10] + offset
    centre = rows[5] + offset
    for i in range(0, stride, WIDTH):
        out = w0 * load(ring, centre + i) + w1 * (load(ring, a1 + i) + load(ring, b1 + i))
        out = out + w2 * (load(ring, a2 + i) + load(ring, b2 + i)) + w3 * (load(ring, a3 + i) + load(ring, b3 + i))
        out = out + w4 * (load(ring, a4 + i) + load(ring, b4 + i)) + w5 * (load(ring, a5 + i) + load(ring, b5 + i))
        store(target, to + i, out)


@njit(error_model="numpy", forceinline=True)
def _size(values: LaneValues) -> LaneValues:
    return select(values < 0.0, -values, values)


@njit(error_model="numpy")
def _compare_band(
    taps: Array,
    images: tuple[Array, ...],
    weights: Array,
    weight_step: int,
    first: int,
    last: int,
    height: int,
    stride: int,
    factors: tuple[np.float32, np.float32],
    maps: Array,
    gradient: Array,
    sums: Array,
) -> None:
    """Compare the rows from `first` to `last - 1`: fill their sums, the L1 gradient and the three maps for `_gather_band`."""
    image, target = images
    span = stride + 2 * _PAD
    padded, ring = np.zeros(5 * span, np.float32), np.zeros(_ROWS * 5 * stride, np.float32)
    means, totals, rows = np.zeros(5 * stride, np.float32), np.zeros(2 * WIDTH, np.float32), np.zeros(_ROWS, np.int64)
    for row in range(first - RADIUS, last + RADIUS):
        slot = (row + _ROWS) % _ROWS * 5 * stride
        if 0 <= row < height:
            for i in range(0, stride, WIDTH):
                x, y = load(image, row * stride + i), load(target, row * stride + i)
                store(padded, _PAD + i, x)
                store(padded, span + _PAD + i, y)
                store(padded, 2 * span + _PAD + i, x * x)
                store(padded, 3 * span + _PAD + i, y * y)
                store(padded, 4 * span + _PAD + i, x * y)
            for quantity in range(5):
                _blur_along(taps, padded, quantity * span + _PAD, ring, slot + quantity * stride, stride)
        else:
            ring[slot : slot + 5 * stride] = 0.0
        out = row - RADIUS
        if out < first:
            continue
        for k in range(_ROWS):
            rows[k] = (out - RADIUS + k + _ROWS) % _ROWS * 5 * stride
        for quantity in range(5):
            _blur_across(taps, ring, rows, quantity * stride, means, quantity * stride, stride)
        sum_l1, sum_ssim = spread(0.0), spread(0.0)
        for i in range(0, stride, WIDTH):
            mx, my, xx = load(means, i), load(means, stride + i), load(means, 2 * stride + i)
            yy, xy = load(means, 3 * stride + i), load(means, 4 * stride + i)
            weight = load(weights, out * weight_step + i)
            a1, a2 = 2.0 * mx * my + C1, 2.0 * (xy - mx * my) + C2
            mean2 = mx * mx + my * my
            b1, b2 = mean2 + C1, xx + yy - mean2 + C2
            r1, r2 = 1.0 / b1, 1.0 / b2
            both = r1 * r2
            value = a1 * a2 * both
            scale = weight * factors[1]
            at = out * stride + i
            store(maps, at, scale * 2.0 * (my * (a2 - a1) * both - value * mx * (r1 - r2)))
            store(maps, height * stride + at, -(scale * value * r2))
            store(maps, 2 * height * stride + at, scale * 2.0 * a1 * both)
            difference = load(image, at) - load(target, at)
            sum_ssim, sum_l1 = sum_ssim + weight * value, sum_l1 + weight * _size(difference)
            slope = weight * factors[0]
            store(gradient, at, select(difference > 0.0, slope, select(difference < 0.0, -slope, spread(0.0))))
        store(totals, 0, sum_l1)
        store(totals, WIDTH, sum_ssim)
        sums[0, out], sums[1, out] = totals[:WIDTH].sum(), totals[WIDTH:].sum()


@njit(error_model="numpy")
def _gather_band(
    taps: Array, images: tuple[Array, ...], first: int, last: int, height: int, stride: int, maps: Array, gradient: Array
) -> None:
    """Add the gradient of SSIM to the rows from `first` to `last - 1`.

    The transpose of the blur is applied to the three maps; it is the blur itself, because the window is symmetric.
    """
    image, target = images
    span = stride + 2 * _PAD
    padded, ring = np.zeros(span, np.float32), np.zeros(_ROWS * 3 * stride, np.float32)
    result, rows = np.zeros(3 * stride, np.float32), np.zeros(_ROWS, np.int64)
    for row in range(first - RADIUS, last + RADIUS):
        slot = (row + _ROWS) % _ROWS * 3 * stride
        if 0 <= row < height:
            for quantity in range(3):
                for i in range(0, stride, WIDTH):
                    store(padded, _PAD + i, load(maps, (quantity * height + row) * stride + i))
                _blur_along(taps, padded, _PAD, ring, slot + quantity * stride, stride)
        else:
            ring[slot : slot + 3 * stride] = 0.0
        out = row - RADIUS
        if out < first:
            continue
        for k in range(_ROWS):
            rows[k] = (out - RADIUS + k + _ROWS) % _ROWS * 3 * stride
        for quantity in range(3):
            _blur_across(taps, ring, rows, quantity * stride, result, quantity * stride, stride)
        for i in range(0, stride, WIDTH):
            at = out * stride + i
            ssim = (
                load(result, i)
                + 2.0 * load(image, at) * load(result, stride + i)
                + load(target, at) * load(result, 2 * stride + i)
            )
            store(gradient, at, load(gradient, at) + ssim)


@njit(error_model="numpy")
def _compare(
    taps: Array,
    images: tuple[Array, ...],
    weights: Array,
    weight_step: int,
    height: int,
    stride: int,
    factors: tuple[np.float32, np.float32],
    with_gradient: bool,
    maps: Array,
    gradient: Array,
    sums: Array,
) -> None:
    """Compute loss and gradient on one thread."""
    _compare_band(taps, images, weights, weight_step, 0, height, height, stride, factors, maps, gradient, sums)
    if with_gradient:
        _gather_band(taps, images, 0, height, height, stride, maps, gradient)


@njit(error_model="numpy", parallel=True)
def _compare_parallel(
    taps: Array,
    images: tuple[Array, ...],
    weights: Array,
    weight_step: int,
    height: int,
    stride: int,
    factors: tuple[np.float32, np.float32],
    with_gradient: bool,
    maps: Array,
    gradient: Array,
    sums: Array,
    bands: int,
) -> None:
    """Do the work of `_compare` in bands of rows; every row is computed in the same way, so the result is bitwise the same."""
    for band in prange(bands):
        first, last = height * band // bands, height * (band + 1) // bands
        _compare_band(taps, images, weights, weight_step, first, last, height, stride, factors, maps, gradient, sums)
    if with_gradient:
        for band in prange(bands):
            first, last = height * band // bands, height * (band + 1) // bands
            _gather_band(taps, images, first, last, height, stride, maps, gradient)


def _rows(image: Array, stride: int) -> Array:
    """Return an image as flat rows of `stride` values, filled up with zeros; no copy is made if nothing is missing."""
    rows = np.ascontiguousarray(image, dtype=np.float32).reshape(len(image), -1)
    missing = stride - rows.shape[1]
    return (np.pad(rows, ((0, 0), (0, missing))) if missing else rows).reshape(-1)


def _evaluate(
    image: Array, target: Array, weights: Array | None, ssim_weight: float, gradient: bool
) -> tuple[float, float, Array]:
    """Return the weighted means of L1 and SSIM and the gradient of the mixed loss. [H, W, 3] -> float, float, [H, W, 3]."""
    height, width = image.shape[:2]
    length = _STEP * width
    stride = -(-length // WIDTH) * WIDTH
    if weights is None:
        spaced, step, total = _rows(np.ones((1, length)), stride), 0, float(height * length)
    else:
        spaced, step = _rows(np.repeat(weights, _STEP, axis=1), stride), stride
        total = _STEP * float(weights.sum(dtype=np.float64))
    share = 1.0 / total if total > 0.0 else 0.0
    out, maps = np.empty(height * stride, np.float32), np.empty(3 * height * stride, np.float32)
    sums = np.empty((2, height))
    factors = np.float32((1.0 - ssim_weight) * share), np.float32(-ssim_weight * share)
    images = _rows(image, stride), _rows(target, stride)
    arguments = (TAPS, images, spaced, step, height, stride, factors, gradient, maps, out, sums)
    if logs.threads() > 1:
        use_threads(logs.threads())
        _compare_parallel(*arguments, logs.threads())
    else:
        _compare(*arguments)
    l1, ssim = sums.sum(axis=1) * share
    return float(l1), float(ssim), out.reshape(height, stride)[:, :length].reshape(image.shape)


class _L1Ssim(torch.autograd.Function):
    """Autograd wrapper of the kernels: the forward pass computes the gradient, and the backward pass only scales it."""

    @staticmethod
    def forward(
        ctx: Any, image: torch.Tensor, target: torch.Tensor, weight: torch.Tensor | None, ssim_weight: float
    ) -> torch.Tensor:
        weights = None if weight is None else weight.detach().numpy()
        l1, ssim, gradient = _evaluate(
            image.detach().numpy(), target.detach().numpy(), weights, ssim_weight, ctx.needs_input_grad[0]
        )
        ctx.gradient = torch.from_numpy(gradient)
        inside = 1.0 if weights is None or weights.any() else 0.0
        return image.new_tensor((1.0 - ssim_weight) * l1 + ssim_weight * (inside - ssim))

    @staticmethod
    def backward(ctx: Any, upstream: torch.Tensor) -> tuple[torch.Tensor, None, None, None]:
        return upstream * ctx.gradient, None, None, None


def l1_ssim(
    image: torch.Tensor, target: torch.Tensor, weight: torch.Tensor | None = None, ssim_weight: float = 0.2
) -> torch.Tensor:
    """Return `(1 - s) mean |image - target| + s (1 - mean SSIM)`, differentiable in `image`.

    Args:
        image: Rendered RGB 0..1. [H, W, 3].
        target: Photo. [H, W, 3].
        weight: Weight of each pixel in both means, not negative; None for equal weights. [H, W].
        ssim_weight: s, 0..1.

    Returns:
        The loss, a scalar; 0 if all weights are 0.

    Raises:
        ValueError: The shapes do not fit together.
    """
    if image.ndim != 3 or image.shape[-1] != 3 or image.shape != target.shape:
        raise ValueError(f"image {tuple(image.shape)} and target {tuple(target.shape)} must both be [H, W, 3]")
    if weight is not None and weight.shape != image.shape[:2]:
        raise ValueError(f"weight has shape {tuple(weight.shape)}, expected {tuple(image.shape[:2])}")
    return _L1Ssim.apply(image, target, weight, ssim_weight)
