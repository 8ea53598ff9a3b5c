"""The rasteriser on the CPU: compiled kernels, reused work spaces, autograd.

The steps are: project and cull, sort by depth, list the splats of every 4x4 block, blend. A single thread runs serial kernels;
several threads share the rows of blocks.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch

from gsbridge import logs
from gsbridge.cameras import Camera, camera_centre
from gsbridge.geometry import Array
from gsbridge.splats.rasterize import binning, blending, directional, preparing, projection
from gsbridge.splats.rasterize import gradients as backward_kernels
from gsbridge.splats.rasterize.lanes import WIDTH
from gsbridge.splats.rasterize.layout import BLOCK, GROUP, LANES, NEAR, TABLE
from gsbridge.splats.rasterize.workspace import Workspace, aligned


class _Pool(threading.local):
    """Work spaces of one thread that are currently not in use."""

    def __init__(self) -> None:
        self.free: list[Workspace] = []

    def take(self) -> Workspace:
        return self.free.pop() if self.free else Workspace()


_pool = _Pool()


class _Lease:
    """Holds a work space until autograd drops the last reference to its rendering, and then returns it to the pool."""

    def __init__(self) -> None:
        self._pool = _pool.free
        self.space = _pool.take()

    def __del__(self) -> None:
        self._pool.append(self.space)


@dataclass(frozen=True)
class _View:
    """The data of a camera that the kernels use; the pose is None if the splats are not in the table frame."""

    camera: Camera
    cam_from_table: Array | None
    near: np.float32

    @property
    def width(self) -> int:
        return self.camera.width

    @property
    def height(self) -> int:
        return self.camera.height

    @property
    def rows(self) -> int:
        return -(-self.camera.height // BLOCK)

    @property
    def columns(self) -> int:
        return -(-self.camera.width // BLOCK)

    @cached_property
    def numbers(self) -> Array:
        """fx, fy, cx, cy, then rotation (row by row) and translation of `cam_from_table`. [16] float32."""
        camera, pose = self.camera, np.asarray(self.cam_from_table, dtype=np.float32)
        numbers = np.concatenate([[camera.fx, camera.fy, camera.cx, camera.cy], pose[:3, :3].reshape(-1), pose[:3, 3]])
        return numbers.astype(np.float32)


@dataclass(frozen=True)
class Seen:
    """The groups of splats that a picture draws, and their frames.

    Args:
        groups: Indices of groups of `layout.GROUP` splats, ascending. [G] int64.
        owners: Row in `views` of each group. [G] int64.
        views: One row per frame of splats: fx, fy, cx, cy, then rotation (row by row) and translation of `cam_from_frame`.
            [F, 16] float32.
    """

    groups: Array
    owners: Array
    views: Array

    @classmethod
    def all(cls, count: int, view: _View) -> Seen:
        """Select all of `count` splats, in one frame."""
        groups = np.arange(-(-count // GROUP))
        return cls(groups, np.zeros_like(groups), view.numbers[None])


@dataclass(frozen=True)
class Prepared:
    """Splats in the form that the kernels take: flat float32 arrays, padded to a multiple of `WIDTH` splats.

    Args:
        count: Number of splats.
        lanes: Output of `preparing.prepare`. [N * `LANES`].
        means, quats, scales, opacities: The splats, for the gradients. [N * 3], [N * 4], [N * 3], [N].
        packed: Colours and harmonics as `directional.packed` returns them; each rendering writes the colours that its camera
            sees into `lanes`. Empty without harmonics. [N * (1 + K) * 3].
        terms: Number of harmonics of each splat in `packed`, K.
    """

    count: int
    lanes: Array
    means: Array
    quats: Array
    scales: Array
    opacities: Array
    packed: Array
    terms: int

    @classmethod
    def of(
        cls, means: Array, quats: Array, scales: Array, opacities: Array, colours: Array, harmonics: Array | None = None
    ) -> Prepared:
        """Prepare splats, in any frame, for many renderings.

        Args:
            means, quats, scales, opacities, colours, harmonics: Splats as in `render`. [N, 3], [N, 4], [N, 3], [N], [N, 3],
                [N, K, 3].
        """
        arrays = _flat(means), _flat(quats), _flat(scales), _flat(opacities), _flat(colours)
        lanes = aligned(len(arrays[3]) * LANES)
        preparing.prepare(*arrays, lanes)
        terms = 0 if harmonics is None else harmonics.shape[1]
        packed = np.zeros(0, np.float32)
        if harmonics is not None and terms > 0:
            packed = directional.packed(arrays[4].reshape(-1, 3), _flat(harmonics).reshape(-1, terms, 3))
        return cls(len(means), lanes, *arrays[:4], packed, terms)


def _flat(array: Array) -> Array:
    """Return a flat float32 array padded to a multiple of `WIDTH` rows, without a copy if none is needed."""
    array = np.ascontiguousarray(array, dtype=np.float32)
    missing = -len(array) % WIDTH
    if missing:
        array = np.concatenate([array, np.zeros((missing, *array.shape[1:]), np.float32)])
    return array.reshape(-1)


def _blocks(space: Workspace, view: _View, background: Array) -> tuple[Any, ...]:
    """Return the arguments that the blending kernels share."""
    lists = (TABLE, space.records, space.entries, space.starts, space.ends)
    return (*lists, view.rows, view.columns, view.width, view.height, background, space.states)


def _forward(
    splats: Prepared,
    view: _View,
    background: Array,
    space: Workspace,
    threads: int,
    seen: Seen | None = None,
    antialiased: bool = False,
) -> tuple[int, tuple[Array, Array, Array]]:
    """Render into new arrays; return the number of visible splats, and colour, alpha and depth (flat)."""
    space.fit(splats.count, view.rows, view.columns)
    if seen is None:
        seen = Seen.all(splats.count, view)
    if splats.terms > 0:
        frames = seen.views.reshape(-1)
        directional.view_groups(splats.packed, splats.terms, splats.count, seen.groups, seen.owners, frames, splats.lanes)
    visible = projection.project(
        splats.lanes,
        splats.count,
        seen.groups,
        seen.owners,
        seen.views.reshape(-1),
        view.near,
        view.width,
        view.height,
        antialiased,
        space.records,
        space.sources,
        space.depths,
        space.boxes,
        space.capacity,
    )
    keys = space.depths.view(np.int32)
    binning.sort_by_depth(keys, visible, space.counts, space.pairs, space.more_pairs, space.order)
    space.fit_entries(binning.reserve(space.capacity, view.rows, view.columns, space.starts, space.running))
    space.ends[:] = space.starts
    binning.fill(space.records, space.boxes, space.order, visible, view.columns, space.ends, space.entries, space.pairs)
    pixels = view.width * view.height
    out = np.empty(3 * pixels, np.float32), np.empty(pixels, np.float32), np.empty(pixels, np.float32)
    blend = blending.blend
    if threads > 1:
        blending.use_threads(threads)
        blend = blending.blend_parallel
    blend(_blocks(space, view, background), out)
    return visible, out


def _backward(
    splats: Prepared,
    view: _View,
    background: Array,
    space: Workspace,
    visible: int,
    gradients: tuple[Array, ...],
    threads: int,
) -> tuple[Array, ...]:
    """Return the gradients of means, quats, scales, opacities and colours."""
    if threads > 1:
        blending.use_threads(threads)
        blocks = _blocks(space, view, background)
        first_band, targets, owners = space.fit_bands(visible)
        own = backward_kernels.share_entries(blocks, threads, first_band, targets, owners)
        sums = space.zero_sums(visible + own)
        backward_kernels.sum_gradients_parallel(blocks, gradients, threads, targets, owners, own, sums)
    else:
        sums = space.zero_sums(visible)
        backward_kernels.sum_gradients(_blocks(space, view, background), gradients, sums)
    n = splats.count
    out = tuple(np.zeros(shape, np.float32) for shape in ((n, 3), (n, 4), (n, 3), (n,), (n, 3)))
    projection.project_backward(
        splats.means,
        splats.quats,
        splats.scales,
        splats.opacities,
        view.numbers,
        view.width,
        view.height,
        space.records,
        space.sources,
        visible,
        sums,
        *(array.reshape(-1) for array in out),
    )
    return out


def render(
    means: Array,
    quats: Array,
    scales: Array,
    opacities: Array,
    colours: Array,
    *,
    camera: Camera,
    cam_from_table: Array,
    background: Array | None = None,
    near: float = NEAR,
    threads: int | None = None,
    harmonics: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Render splats, without gradients.

    Args:
        means, quats, scales, opacities, colours: Splats as in `gsbridge.splats.rasterize.rasterize`, but numpy arrays. [N, 3],
            [N, 4], [N, 3], [N], [N, 3].
        camera, cam_from_table: Pinhole camera, and its pose. [4, 4].
        background: Colour behind the splats; None for black. [3].
        near: Smallest camera z of a centre, m.
        threads: Number of threads; None for as many as the job may use.
        harmonics: Coefficients of the colours' dependence on viewing direction; None for no dependence. [N, K, 3].

    Returns:
        Colour [H, W, 3], alpha [H, W], and the alpha-weighted sum of camera z, m. [H, W].
    """
    behind = np.zeros(3, np.float32) if background is None else np.asarray(background, dtype=np.float32)
    view = _View(camera, cam_from_table, np.float32(near))
    if harmonics is not None:
        colours = directional.viewed(means, colours, harmonics, camera_centre(cam_from_table))
    return _render(Prepared.of(means, quats, scales, opacities, colours), view, behind, threads, None)


def render_seen(
    splats: Prepared,
    seen: Seen,
    *,
    camera: Camera,
    background: Array,
    near: float = NEAR,
    threads: int | None = None,
    antialiased: bool = False,
) -> tuple[Array, Array, Array]:
    """Render some groups of splats, each in its own frame, without gradients.

    Args:
        splats, seen: All splats; the groups to draw, with their frames.
        camera: Pinhole camera, of which only the image size is used; focal lengths and poses are those of `seen.views`.
        background, near, threads: As in `render`. [3].
        antialiased: Whether to lower a splat's opacity by the factor by which the screen blur enlarges its area
            (Mip-Splatting), so that small things keep their size.

    Returns:
        Colour, alpha and weighted camera z, as `render` does.
    """
    view = _View(camera, None, np.float32(near))
    return _render(splats, view, np.asarray(background, dtype=np.float32), threads, seen, antialiased)


def _render(
    splats: Prepared, view: _View, behind: Array, threads: int | None, seen: Seen | None, antialiased: bool = False
) -> tuple[Array, Array, Array]:
    """Render in a work space from the pool."""
    space = _pool.take()
    try:
        _, images = _forward(splats, view, behind, space, logs.threads() if threads is None else threads, seen, antialiased)
    finally:
        _pool.free.append(space)
    return _shape(images, view)


def _shape(images: tuple[Array, Array, Array], view: _View) -> tuple[Array, Array, Array]:
    size = (view.height, view.width)
    return images[0].reshape(*size, 3), images[1].reshape(size), images[2].reshape(size)


class _Rasterize(torch.autograd.Function):
    """Autograd wrapper of the kernels."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[torch.Tensor, ...]:
        *splat_tensors, view, background, threads = inputs
        splats = Prepared.of(*(tensor.detach().numpy() for tensor in splat_tensors))
        lease = _Lease()
        visible, images = _forward(splats, view, background, lease.space, threads)
        ctx.state = (splats, view, background, lease, visible, threads)
        return tuple(torch.from_numpy(image) for image in _shape(images, view))

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        splats, view, background, lease, visible, threads = ctx.state
        flat = tuple(gradient.contiguous().numpy().reshape(-1) for gradient in gradients)
        out = _backward(splats, view, background, lease.space, visible, flat, threads)
        return (*(torch.from_numpy(array) for array in out), None, None, None)


def rasterize(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    opacities: torch.Tensor,
    colours: torch.Tensor,
    camera: Camera,
    cam_from_table: Array,
    background: torch.Tensor | None,
    near: float,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Render with the backend `cpu`; `gsbridge.splats.rasterize.rasterize` has checked the shapes.

    Args:
        means, quats, scales, opacities, colours: Splats, m, with gradients. [N, 3], [N, 4], [N, 3], [N], [N, 3].
        camera, cam_from_table, background, near: As in `render`. [4, 4], [3].

    Returns:
        Colours, alphas and depths, as in `gsbridge.splats.rasterize.Rendering`.
    """
    behind = np.zeros(3, np.float32) if background is None else background.detach().numpy().astype(np.float32)
    view = _View(camera, cam_from_table, np.float32(near))
    groups = (group.float() for group in (means, quats, scales, opacities, colours))
    return _Rasterize.apply(*groups, view, behind, logs.threads())
