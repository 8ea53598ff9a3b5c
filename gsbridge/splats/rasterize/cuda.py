"""The rasteriser on an NVIDIA device, through gsplat (optional extra `cuda`).

gsplat clips alpha at 0.999 where the other backends clip at 0.99, and it finishes a pixel before, not after, the splat that
takes the transmittance below 1e-4. Otherwise the definitions agree.
"""

from __future__ import annotations

from typing import Any

import torch

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.splats.rasterize.layout import BLUR

_SETTING = "splats.backend"


def _rasterization(device: torch.device) -> Any:
    """Return gsplat's function, after a check that it can run.

    Raises:
        InputError: gsplat or a CUDA device is missing, or the tensors are not on a CUDA device.
    """
    if not torch.cuda.is_available():
        raise InputError(_SETTING, "'cuda' needs an NVIDIA device and a CUDA build of torch", "Use 'cpu'")
    try:
        from gsplat import rasterization
    except ImportError as error:
        raise InputError(_SETTING, f"'cuda' needs gsplat ({error})", "Install the extra 'cuda', or use 'cpu'") from error
    if device.type != "cuda":
        raise InputError(_SETTING, f"the splats are on '{device}'", "Move the tensors to the CUDA device first")
    return rasterization


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
    """Render with the backend `cuda`; `gsbridge.splats.rasterize.rasterize` has checked the shapes.

    Args:
        means, quats, scales, opacities, colours: Splats, m, with gradients. [N, 3], [N, 4], [N, 3], [N], [N, 3].
        camera: Pinhole camera.
        cam_from_table: Pose of the camera. [4, 4].
        background: Colour behind the splats; None for black. [3].
        near: Smallest camera z of a centre, m.

    Returns:
        Colours, alphas and depths, as in `gsbridge.splats.rasterize.Rendering`.

    Raises:
        InputError: gsplat or a CUDA device is missing, or the tensors are not on a CUDA device.
    """
    rasterization = _rasterization(means.device)
    groups = (means, quats, scales, opacities, colours)
    sound = torch.stack([torch.isfinite(group.detach().reshape(len(means), -1)).all(-1) for group in groups]).all(0)
    if not bool(sound.all()):
        means, quats, scales, opacities, colours = (group[sound] for group in groups)
    kind: dict[str, Any] = {"dtype": torch.float32, "device": means.device}
    images, alphas, _ = rasterization(
        means,
        quats,
        scales,
        opacities,
        colours,
        torch.as_tensor(cam_from_table, **kind)[None],
        torch.as_tensor(camera.intrinsics, **kind)[None],
        camera.width,
        camera.height,
        near_plane=near,
        eps2d=BLUR,
        render_mode="RGB+D",
    )
    alpha = alphas[0, ..., 0]
    colour = images[0, ..., :3]
    if background is not None:
        colour = colour + (1.0 - alpha)[..., None] * background.detach().to(**kind)
    return colour, alpha, images[0, ..., 3]
