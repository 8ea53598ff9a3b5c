"""How well splats show the photos: PSNR, SSIM, LPIPS and the overlap of their silhouette with the mask."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gsbridge.cameras import Camera
from gsbridge.files import atomic_directory
from gsbridge.geometry import Array
from gsbridge.images import SSIM_RADIUS, linear_from_srgb, srgb_from_linear, ssim_map, write_image
from gsbridge.photogrammetry.matting import background_of
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.lpips import Lpips
from gsbridge.splats.rasterize import rasterize
from gsbridge.splats.targets import Target

logger = logging.getLogger("gsbridge")

SPLITS = ("train", "held_out")
REGIONS = ("masked", "full")
AMPLIFIED = 5.0
"""Factor of the difference pictures."""


def render_cloud(cloud: Cloud, camera: Camera, cam_from_table: Array) -> tuple[Array, Array]:
    """Colour over black [H, W, 3] and alpha [H, W] of a cloud, float32.

    Args:
        cloud: The Gaussians, table frame.
        camera: Pinhole camera.
        cam_from_table: Pose of the camera. [4, 4].
    """
    with torch.no_grad():
        rendering = rasterize(
            *(torch.from_numpy(x) for x in (cloud.means, cloud.quats, cloud.scales, cloud.opacities, cloud.colours)),
            camera=camera,
            cam_from_table=cam_from_table,
            harmonics=torch.from_numpy(cloud.harmonics),
        )
    return rendering.colours.numpy(), rendering.alphas.numpy()


def evaluate_cloud(
    cloud: Cloud, targets: Sequence[Target], *, kind: str, lpips: Lpips | None = None
) -> dict[str, dict[str, dict[str, Any]]]:
    """Mean metrics over the views of each split and region.

    `masked` counts the pixels of the mask (objects) or of the table mesh (backgrounds) and compares with the photo as it was
    taken: an object's rendering is laid over the photo's own background, in linear light as a lens mixes them. `full` counts
    the whole frame, which is the paper's protocol: objects stand on black, cut out and unmixed as in training; backgrounds
    are compared with the bare photo.

    Args:
        cloud: Trained splats.
        targets: Photos of both splits.
        kind: `object` or `background`.
        lpips: Perceptual metric, where its weights are there.

    Returns:
        `[split][region]` with `views`, `psnr` (dB), `ssim`, `lpips`, `alpha_iou` (objects only); None where not measured.
    """
    rows: dict[tuple[str, str], list[tuple[float, ...]]] = {(split, region): [] for split in SPLITS for region in REGIONS}
    for target in targets:
        for region, values in zip(REGIONS, _measure(cloud, target, kind, lpips), strict=True):
            rows[target.split, region].append(values)
    names = ("psnr", "ssim", "lpips", "alpha_iou")

    def mean(values: list[tuple[float, ...]]) -> dict[str, Any]:
        means = np.mean(values, axis=0) if values else np.full(len(names), np.nan)
        return {
            "views": len(values),
            **{name: float(x) if np.isfinite(x) else None for name, x in zip(names, means, strict=True)},
        }

    return {split: {region: mean(rows[split, region]) for region in REGIONS} for split in SPLITS}


def _measure(cloud: Cloud, target: Target, kind: str, lpips: Lpips | None) -> list[tuple[float, ...]]:
    """PSNR, SSIM, LPIPS and alpha IoU of one photo, masked and full."""
    whole = target.whole
    colours, alphas = render_cloud(cloud, whole, target.cam_from_table)
    height, width = target.photo.shape[:2]
    part = np.s_[target.top : target.top + height, target.left : target.left + width]
    weight = np.zeros((whole.height, whole.width), np.float32)
    weight[part] = target.weight.astype(np.float32) / 255
    photo = np.zeros((whole.height, whole.width, 3), np.float32)
    photo[part] = target.photo.astype(np.float32) / 255
    iou = float("nan")
    colours = np.clip(colours, 0, 1)
    shown_in_place, photo_in_place = colours, photo
    if kind == "object":
        photo = photo * weight[..., None]
        photo_in_place = np.zeros_like(photo)
        photo_in_place[part] = target.unedited.astype(np.float32) / 255
        shown_in_place = photo_in_place.copy()
        behind = background_of(target.unedited, weight[part])
        shown_in_place[part] = _laid_over(colours[part], alphas[part], behind)
        inside, shown = weight > 0.5, alphas > 0.5
        iou = float((inside & shown).sum() / max((inside | shown).sum(), 1))
    # Outside this window both images are equal: there the error is 0 and the similarity 1.
    window = _window((alphas > 0) | (photo.max(-1) > 0), 2 * SSIM_RADIUS + 1)
    rows: list[tuple[float, ...]] = []
    for region, image, reference, count in (
        ("masked", shown_in_place, photo_in_place, weight),
        ("full", colours, photo, np.ones_like(weight)),
    ):
        squared = ((image - reference) ** 2).mean(-1, dtype=np.float64)
        similar = np.ones(squared.shape)
        similar[window] = ssim_map(image[window], reference[window])
        perceived = float("nan")
        if lpips is not None:
            covered = count[..., None]
            where = window if region == "masked" else np.s_[:, :]
            perceived = lpips((image * covered)[where], (reference * covered)[where])
        total = max(count.sum(), 1e-12)
        rows.append(
            (
                float(-10 * np.log10(max((squared * count).sum() / total, 1e-12))),
                float((similar * count).sum() / total),
                perceived,
                iou,
            )
        )
    return rows


def _laid_over(colours: Array, alphas: Array, behind: Array) -> Array:
    """A rendering over a photo's background, mixed in linear light. [H, W, 3], [H, W], [H, W, 3] linear -> sRGB [H, W, 3]."""
    own = linear_from_srgb(np.clip(colours / np.maximum(alphas, 1e-4)[..., None], 0, 1))
    share = np.clip(alphas, 0, 1)[..., None]
    return np.clip(srgb_from_linear(share * own + (1 - share) * behind), 0, 1)


def _window(used: Array, margin: int) -> tuple[slice, slice]:
    """Slices of the bounding box of true pixels and a margin, px; everything where none is true."""
    rows, columns = np.flatnonzero(used.any(1)), np.flatnonzero(used.any(0))
    if len(rows) == 0:
        return np.s_[:, :]
    height, width = used.shape
    return (
        slice(max(0, rows[0] - margin), min(height, rows[-1] + 1 + margin)),
        slice(max(0, columns[0] - margin), min(width, columns[-1] + 1 + margin)),
    )


def write_pictures(folder: str | Path, cloud: Cloud, targets: Sequence[Target], *, kind: str, count: int) -> list[str]:
    """Store photo, rendering and amplified difference side by side, for held-out views spread over the path.

    Args:
        folder: Replaced whole.
        cloud: Trained splats.
        targets: Photos; where none is held out, training photos are shown.
        kind: `object` or `background`.
        count: Number of pictures.

    Returns:
        File names.
    """
    chosen = [target for target in targets if target.split == "held_out"] or list(targets)
    chosen = [chosen[i] for i in sorted(set(np.linspace(0, len(chosen) - 1, min(count, len(chosen))).round().astype(int)))]
    names = []
    with atomic_directory(folder) as temporary:
        for target in chosen:
            colours, alphas = render_cloud(cloud, target.camera, target.cam_from_table)
            weight = target.weight.astype(np.float32)[..., None] / 255
            photo = target.photo.astype(np.float32) / 255
            # Grey behind an object shows dark and light halos alike.
            behind = 0.5
            shown = colours + behind * (1 - alphas[..., None])
            photo = photo * weight + behind * (1 - weight) if kind == "object" else photo
            difference = np.abs(shown - photo) * (1 if kind == "object" else weight)
            names.append(f"{Path(target.name).stem}.png")
            write_image(temporary / names[-1], np.concatenate([photo, shown, np.clip(AMPLIFIED * difference, 0, 1)], axis=1))
    return names
