"""The rasteriser in plain torch: the reference for the tests, in the precision of its inputs.

It uses the definitions of the kernels but none of their algorithms: every splat is evaluated at every pixel, and autograd gives
the gradients. With `tile`, a tile is blended only from the splats whose bounding box meets it, which makes larger images
possible.
"""

from __future__ import annotations

from typing import Any

import torch

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.splats.rasterize.layout import ALPHA_MAX, ALPHA_MIN, BLUR, LIGHT_MIN, MARGIN


def rotations(quats: torch.Tensor) -> torch.Tensor:
    """Return the rotation matrices of quaternions wxyz of any length except zero. [N, 4] -> [N, 3, 3]."""
    w, x, y, z = torch.nn.functional.normalize(quats, dim=-1).unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


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
    tile: int | None = None,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Render with the backend `reference`; `gsbridge.splats.rasterize.rasterize` has checked the shapes.

    Args:
        means, quats, scales, opacities, colours: Splats, m, with gradients, of any floating type. [N, 3], [N, 4],
            [N, 3], [N], [N, 3].
        camera: Pinhole camera.
        cam_from_table: Pose of the camera. [4, 4].
        background: Colour behind the splats; None for black. [3].
        near: Smallest camera z of a centre, m.
        tile: Edge of the tiles, px; None blends all splats over all pixels at once.
    """
    kind: dict[str, Any] = {"dtype": means.dtype, "device": means.device}
    pose = torch.as_tensor(cam_from_table, **kind)
    sound = torch.stack(
        [torch.isfinite(v.reshape(len(means), -1)).all(-1) for v in (means, quats, scales, opacities, colours)]
    ).all(0)
    keep = torch.nonzero(sound & (means.detach() @ pose[2, :3] + pose[2, 3] >= near) & (opacities > ALPHA_MIN))[:, 0]
    points = means[keep] @ pose[:3, :3].T + pose[:3, 3]
    order = torch.argsort(points[:, 2].detach(), stable=True)
    keep, points = keep[order], points[order]
    x, y, z = points.unbind(-1)

    tan_x, tan_y = 0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy
    u = (x / z).clamp(-camera.cx / camera.fx - MARGIN * tan_x, (camera.width - camera.cx) / camera.fx + MARGIN * tan_x)
    v = (y / z).clamp(-camera.cy / camera.fy - MARGIN * tan_y, (camera.height - camera.cy) / camera.fy + MARGIN * tan_y)
    zero = torch.zeros_like(z)
    slope = torch.stack(
        [
            torch.stack([camera.fx / z, zero, -camera.fx * u / z], -1),
            torch.stack([zero, camera.fy / z, -camera.fy * v / z], -1),
        ],
        -2,
    )
    root = slope @ pose[:3, :3] @ rotations(quats[keep]) * scales[keep][:, None, :]
    covariance = root @ root.transpose(1, 2) + BLUR * torch.eye(2, **kind)
    inverse = torch.linalg.inv(covariance)
    centre = torch.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], -1)
    half = (
        torch.sqrt(2.0 * torch.log(opacities[keep].detach() / ALPHA_MIN))[:, None]
        * covariance.detach().diagonal(dim1=1, dim2=2).sqrt()
    )

    behind = torch.zeros(3, **kind) if background is None else background.detach().to(**kind)
    features = torch.cat([colours[keep], torch.ones_like(z)[:, None], z[:, None]], -1)
    edge = tile or max(camera.width, camera.height)
    rows = []
    for top in range(0, camera.height, edge):
        row = []
        for left in range(0, camera.width, edge):
            size = (min(edge, camera.height - top), min(edge, camera.width - left))
            corner = torch.tensor([left, top], **kind)
            far = torch.tensor([left + size[1], top + size[0]], **kind)
            here = torch.nonzero(((centre + half >= corner) & (centre - half <= far)).all(-1).detach())[:, 0]
            row.append(_blend(here, centre, inverse, opacities[keep], features, left, top, size))
        rows.append(torch.cat(row, 1))
    image = torch.cat(rows, 0)
    alpha = image[..., 3]
    return image[..., :3] + (1.0 - alpha)[..., None] * behind, alpha, image[..., 4]


def _blend(
    here: torch.Tensor,
    centre: torch.Tensor,
    inverse: torch.Tensor,
    opacities: torch.Tensor,
    features: torch.Tensor,
    left: int,
    top: int,
    size: tuple[int, int],
) -> torch.Tensor:
    """Blend splats, nearest first, over a rectangle of pixels. -> [h, w, features]."""
    ys = torch.arange(size[0], dtype=centre.dtype, device=centre.device) + (top + 0.5)
    xs = torch.arange(size[1], dtype=centre.dtype, device=centre.device) + (left + 0.5)
    dx = xs[None, None, :] - centre[here, 0, None, None]
    dy = ys[None, :, None] - centre[here, 1, None, None]
    a, b, c = (inverse[here][:, i, j, None, None] for i, j in ((0, 0), (0, 1), (1, 1)))
    falloff = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
    alpha = (opacities[here][:, None, None] * torch.exp(-falloff)).clamp(max=ALPHA_MAX)
    alpha = torch.where(alpha >= ALPHA_MIN, alpha, 0.0)
    light = torch.cumprod(torch.cat([torch.ones_like(alpha[:1]), 1.0 - alpha]), 0)[:-1]
    weight = torch.where(light >= LIGHT_MIN, alpha * light, 0.0)
    return torch.einsum("nhw,nf->hwf", weight, features[here])
