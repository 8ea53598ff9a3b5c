"""Quality of splats against photos: PSNR, SSIM, LPIPS and the overlap (IoU) of their silhouette with the mask."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gsbridge.cameras import Camera, camera_centre
from gsbridge.files import atomic_directory
from gsbridge.geometry import Array
from gsbridge.images import SSIM_RADIUS, linear_from_srgb, srgb_from_linear, ssim_map, write_image
from gsbridge.photogrammetry.matting import background_of
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.exposure import Exposure, fitted
from gsbridge.splats.lpips import Lpips
from gsbridge.splats.rasterize import rasterize
from gsbridge.splats.rasterize.directional import viewed
from gsbridge.splats.targets import Target

logger = logging.getLogger("gsbridge")

SPLITS = ("train", "held_out")
REGIONS = ("masked", "full")
SURE = 0.95
"""Alpha above which a pixel is used to fit the exposure of a held-out photo."""
AMPLIFIED = 5.0
"""Factor by which differences are amplified in the pictures."""


def render_cloud(cloud: Cloud, camera: Camera, cam_from_table: Array, exposure: Exposure | None = None) -> tuple[Array, Array]:
    """Render colour over black [H, W, 3] and alpha [H, W] of a cloud, float32.

    Args:
        cloud: The Gaussians, table frame.
        camera: Pinhole camera.
        cam_from_table: Pose of the camera. [4, 4].
        exposure: Exposure with which the splats' colours are shown; None for the colours as they are.
    """
    if exposure is not None:
        shown = viewed(cloud.means, cloud.colours, cloud.harmonics, camera_centre(cam_from_table))
        cloud = Cloud(cloud.means, cloud.quats, cloud.scales, cloud.opacities, exposure.apply(shown))
    with torch.no_grad():
        rendering = rasterize(
            *(torch.from_numpy(x) for x in (cloud.means, cloud.quats, cloud.scales, cloud.opacities, cloud.colours)),
            camera=camera,
            cam_from_table=cam_from_table,
            harmonics=torch.from_numpy(cloud.harmonics),
        )
    return rendering.colours.numpy(), rendering.alphas.numpy()


def evaluate_cloud(
    cloud: Cloud,
    targets: Sequence[Target],
    *,
    kind: str,
    lpips: Lpips | None = None,
    exposures: Mapping[str, Exposure] | None = None,
) -> dict[str, dict[str, dict[str, Any]]]:
    """Compute the mean metrics over the views of each split and region.

    `masked` counts the pixels of the mask (objects) or of the table mesh (backgrounds) and compares with the photo as it was
    taken. For this, an object's rendering is laid over the photo's own background, mixed in linear light as in a lens. `full`
    counts the whole frame, as in the paper. For it, objects are on black, with the photo cut out and unmixed as in training;
    backgrounds are compared with the photo itself.

    Args:
        cloud: Trained splats.
        targets: Photos of both splits.
        kind: `object` or `background`.
        lpips: Perceptual metric; None if its weights are not available.
        exposures: Exposures of the training photos, by name; each half of a held-out photo then gets the exposure that was
            fitted to its other half. None if all photos have one exposure.

    Returns:
        `[split][region]` with `views`, `psnr` (dB), `ssim`, `lpips`, `alpha_iou` (objects only); None where not measured.
    """
    rows: dict[tuple[str, str], list[tuple[float, ...]]] = {(split, region): [] for split in SPLITS for region in REGIONS}
    for target in targets:
        for region, values in zip(REGIONS, _measure(cloud, target, kind, lpips, exposures), strict=True):
            rows[target.split, region].append(values)
    names = ("psnr", "ssim", "lpips", "alpha_iou")

    def mean(values: list[tuple[float, ...]]) -> dict[str, Any]:
        means = np.mean(values, axis=0) if values else np.full(len(names), np.nan)
        return {
            "views": len(values),
            **{name: float(x) if np.isfinite(x) else None for name, x in zip(names, means, strict=True)},
        }

    return {split: {region: mean(rows[split, region]) for region in REGIONS} for split in SPLITS}


def _rendered(
    cloud: Cloud, target: Target, camera: Camera, left: int, top: int, exposures: Mapping[str, Exposure] | None
) -> tuple[Array, Array]:
    """Render colour over black and alpha of a target's view, in the exposure of its photo.

    Args:
        cloud: Splats.
        target: Photo.
        camera: Camera of the whole photo or of the target's part of it.
        left, top: Position of the target's part in that camera's image, px.
        exposures: See `evaluate_cloud`.
    """
    pose = target.cam_from_table
    if exposures is None:
        return render_cloud(cloud, camera, pose)
    if target.name in exposures:
        return render_cloud(cloud, camera, pose, exposures[target.name])
    colours, alphas = render_cloud(cloud, camera, pose)
    height, width = target.photo.shape[:2]
    part = np.s_[top : top + height, left : left + width]
    share = alphas[part]
    sure = (target.weight == 255) & (share > SURE)
    # Split the photo so that both halves have the same number of usable pixels.
    middle = int(np.median(np.nonzero(sure)[1])) + 1 if sure.any() else width // 2
    columns = np.arange(width)
    drawn = linear_from_srgb(np.clip(colours[part] / np.maximum(share, 1e-4)[..., None], 0, 1))
    seen = linear_from_srgb(target.photo.astype(np.float32) / 255)
    out = colours.copy()
    for scored in (columns < middle, columns >= middle):
        other = sure & ~scored
        there = np.arange(camera.width) < left + middle
        there = there if scored[0] else ~there
        out[:, there] = render_cloud(cloud, camera, pose, fitted(drawn[other], seen[other]))[0][:, there]
    return out, alphas


def _measure(
    cloud: Cloud, target: Target, kind: str, lpips: Lpips | None, exposures: Mapping[str, Exposure] | None
) -> list[tuple[float, ...]]:
    """Return PSNR, SSIM, LPIPS and alpha IoU of one photo, for the regions `masked` and `full`."""
    whole = target.whole
    colours, alphas = _rendered(cloud, target, whole, target.left, target.top, exposures)
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
    # Outside this window both images are equal, so the error is 0 and the similarity 1 there.
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
    """Lay a rendering over a background, mixed in linear light. [H, W, 3], [H, W], [H, W, 3] linear -> sRGB [H, W, 3]."""
    own = linear_from_srgb(np.clip(colours / np.maximum(alphas, 1e-4)[..., None], 0, 1))
    share = np.clip(alphas, 0, 1)[..., None]
    return np.clip(srgb_from_linear(share * own + (1 - share) * behind), 0, 1)


def _window(used: Array, margin: int) -> tuple[slice, slice]:
    """Return slices of the bounding box of true pixels with a margin, px; the whole image if no pixel is true."""
    rows, columns = np.flatnonzero(used.any(1)), np.flatnonzero(used.any(0))
    if len(rows) == 0:
        return np.s_[:, :]
    height, width = used.shape
    return (
        slice(max(0, rows[0] - margin), min(height, rows[-1] + 1 + margin)),
        slice(max(0, columns[0] - margin), min(width, columns[-1] + 1 + margin)),
    )


def write_pictures(
    folder: str | Path,
    cloud: Cloud,
    targets: Sequence[Target],
    *,
    kind: str,
    count: int,
    exposures: Mapping[str, Exposure] | None = None,
) -> list[str]:
    """Write photo, rendering and amplified difference side by side, for held-out views spread over the path.

    Args:
        folder: Folder for the pictures; an existing one is replaced as a whole.
        cloud: Trained splats.
        targets: Photos; if none is held out, training photos are shown.
        kind: `object` or `background`.
        count: Largest number of pictures.
        exposures: See `evaluate_cloud`.

    Returns:
        File names.
    """
    chosen = [target for target in targets if target.split == "held_out"] or list(targets)
    chosen = [chosen[i] for i in sorted(set(np.linspace(0, len(chosen) - 1, min(count, len(chosen))).round().astype(int)))]
    names = []
    with atomic_directory(folder) as temporary:
        for target in chosen:
            colours, alphas = _rendered(cloud, target, target.camera, 0, 0, exposures)
            weight = target.weight.astype(np.float32)[..., None] / 255
            photo = target.photo.astype(np.float32) / 255
            # Use grey behind an object, on which both dark and light halos are visible.
            behind = 0.5
            shown = colours + behind * (1 - alphas[..., None])
            photo = photo * weight + behind * (1 - weight) if kind == "object" else photo
            difference = np.abs(shown - photo) * (1 if kind == "object" else weight)
            names.append(f"{Path(target.name).stem}.png")
            write_image(temporary / names[-1], np.concatenate([photo, shown, np.clip(AMPLIFIED * difference, 0, 1)], axis=1))
    return names
