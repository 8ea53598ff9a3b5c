"""Training of the splats of one model, with one trainer for all bindings, objects and backgrounds.

In each step, objects are composited over a random colour, with the mask as alpha, so that a splat outside the mask causes an
error. For backgrounds, only pixels that see the table mesh count. They are rendered over a random colour, too, so that a hole
causes an error.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from gsbridge.configuration.splats import SplatSettings
from gsbridge.errors import StageError
from gsbridge.files import atomic_file
from gsbridge.logs import ProgressLog
from gsbridge.splats.binding import Binding
from gsbridge.splats.exposure import Exposures
from gsbridge.splats.losses import l1_ssim
from gsbridge.splats.rasterize import rasterize, seen_colours
from gsbridge.splats.targets import Target

logger = logging.getLogger("gsbridge")

CURVE_EVERY = 50
"""Number of steps between two points of the training curve."""

CHECKPOINT_EVERY = 250
"""Number of steps between two checkpoints."""


@dataclass(frozen=True)
class Rates:
    """Step sizes of Adam at the start, per parameter; all decay to the share `SplatSettings.decay` of these values.

    Args:
        weights: Raw weights inside the face.
        offset: Offset along the normal, m per step.
        multiplier: Common factor of the standard deviations.
        opacity: Logit of the opacity.
        colour: sRGB colour, 0..1.
        turn: Quaternion in the face's frame (`refined`) or in the table frame (`unbound`).
        stretch: Logarithm of each standard deviation (`refined`, `unbound`).
        means: Centre, m per step (`unbound`).
        vertices: Vertices of the mesh, m per step (`games_vertices`).
        harmonics: Coefficients of the spherical harmonics besides the constant one.
        exposure_gains: Logarithmic gains of a photo.
        exposure_offsets: Offsets of a photo, linear light.
    """

    weights: float = 0.01
    offset: float = 60e-6
    multiplier: float = 0.02
    opacity: float = 0.1
    colour: float = 0.02
    turn: float = 0.01
    stretch: float = 0.01
    means: float = 60e-6
    vertices: float = 60e-6
    harmonics: float = 0.005
    exposure_gains: float = 0.02
    exposure_offsets: float = 0.001


def train(
    binding: Binding,
    targets: Sequence[Target],
    settings: SplatSettings,
    *,
    kind: str,
    seed: int,
    state: Path,
    inputs: str = "",
    rates: Rates = Rates(),
    exposures: Exposures | None = None,
) -> list[list[float]]:
    """Fit the binding's parameters to the training targets, in place.

    A call with the same arguments after an interruption continues from the last checkpoint and gives the same result.

    Args:
        binding: Splats at the start of training.
        targets: Photos; only those of the split `train` are used.
        settings: Number of steps, decay of the step sizes, and other settings of the training.
        kind: `object` or `background`.
        seed: Seed of the order of photos and of the colours behind the splats.
        state: Folder of the checkpoint, one per training.
        inputs: Digest of the inputs; a checkpoint with another digest is not used.
        rates: Step sizes at the start.
        exposures: Exposures of the photos of the split `train`, in their order, also fitted in place; None if all photos have
            one exposure.

    Returns:
        Training curve. Each point has the step, the mean loss and the PSNR (dB, over the pixels that count) since the point
        before. [[3], ...].

    Raises:
        StageError: The loss became infinite or NaN.
    """
    photos = [target.affordable(settings.max_pixels, kind=kind) for target in targets if target.split == "train"]
    halves = [target.reduced(0.5, kind=kind) for target in photos] if settings.half_size > 0 else photos
    learned = binding.parameters | ({} if exposures is None else exposures.parameters)
    optimizer, starts = _optimizer(learned, binding.band, rates)
    checkpoint = Path(state) / "checkpoint.pt"
    begin, curve, recent = _resume(checkpoint, learned, optimizer, inputs)
    frames = binding.frames()
    progress = ProgressLog(settings.steps - begin, f"train {binding.kind}")
    for step in range(begin, settings.steps):
        order = np.random.default_rng([seed, 1, step // len(photos)]).permutation(len(photos))
        index = order[step % len(photos)]
        target = (halves if step < settings.half_size * settings.steps else photos)[index]
        behind = torch.as_tensor(np.random.default_rng([seed, 2, step]).random(3, dtype=np.float32))
        for group, rate in zip(optimizer.param_groups, starts, strict=True):
            group["lr"] = rate * settings.decay ** (step / settings.steps)
        optimizer.zero_grad(set_to_none=True)
        if "vertices" in binding.parameters:
            frames = binding.frames()
        loss, error = _loss(binding, frames, target, behind, settings, kind, exposures, index)
        loss.backward()
        optimizer.step()
        with torch.no_grad():
            binding.parameters["colour"].clamp_(0, 1)
        recent.append([loss.item(), error])
        if not np.isfinite(recent[-1][0]):
            raise StageError("splats", f"the loss is no number at step {step}", "Lower `Rates` in gsbridge/splats/train.py")
        if (step + 1) % CURVE_EVERY == 0 or step + 1 == settings.steps:
            mean_loss, mean_error = np.mean(recent, axis=0)
            curve.append([step + 1, float(mean_loss), float(-10 * np.log10(max(mean_error, 1e-12)))])
            recent.clear()
        if (step + 1) % CHECKPOINT_EVERY == 0:
            _save(checkpoint, learned, optimizer, step + 1, curve, recent, inputs)
        progress.update(f"loss {curve[-1][1]:.4f}" if curve else "")
    for value in learned.values():
        value.requires_grad_(False)
        value.grad = None
    binding.settle()
    return curve


def _loss(
    binding: Binding,
    frames: tuple[Tensor, ...],
    target: Target,
    behind: Tensor,
    settings: SplatSettings,
    kind: str,
    exposures: Exposures | None,
    photo_number: int,
) -> tuple[Tensor, float]:
    """Return the loss of one photo, and the mean squared error of the pixels that count."""
    shape = binding.shape(frames)  # type: ignore[arg-type]
    # Parameters stay on the CPU: their arithmetic costs little compared with the rendering, on CPU or GPU.
    device = "cuda" if settings.backend == "cuda" else "cpu"
    colour, harmonics = binding.parameters["colour"], binding.parameters.get("harmonics")
    if exposures is not None:
        if harmonics is not None:
            colour, harmonics = seen_colours(shape.means, colour, harmonics, target.cam_from_table), None
        colour = exposures.apply(colour, photo_number)
    splats = (*shape, torch.sigmoid(binding.parameters["opacity"]), colour)
    rendering = rasterize(
        *(item.to(device) for item in splats),
        camera=target.camera,
        cam_from_table=target.cam_from_table,
        background=behind.to(device),
        backend=settings.backend,
        harmonics=harmonics if harmonics is None else harmonics.to(device),
    )
    colours = rendering.colours.cpu()
    photo = torch.as_tensor(target.photo).float().div_(255)
    weight = torch.as_tensor(target.weight).float().div_(255)
    if kind == "object":
        alpha = weight[..., None]
        photo = photo * alpha + behind * (1 - alpha)
        loss = l1_ssim(colours, photo, ssim_weight=settings.ssim_weight)
    else:
        loss = l1_ssim(colours, photo, weight=weight, ssim_weight=settings.ssim_weight)
    with torch.no_grad():
        squared = (colours.detach() - photo).square_().mean(-1)
        error = float((squared * weight).sum() / weight.sum().clamp_min(1e-6))
    if settings.offset_penalty > 0 and "offset" in binding.parameters:
        loss = loss + settings.offset_penalty * torch.tanh(binding.parameters["offset"]).square().mean()
    if exposures is not None:
        loss = loss + exposures.penalty()
    return loss, error


def _optimizer(learned: dict[str, Tensor], band: float, rates: Rates) -> tuple[torch.optim.Adam, list[float]]:
    """Create Adam over all parameters, and return it with the step size of each group at the start."""
    steps = {
        "weights": rates.weights,
        # The offset is band * tanh(b), whose slope at b = 0 is `band`, so that a step of b moves a splat by `rates.offset`.
        "offset": rates.offset / band,
        "multiplier": rates.multiplier,
        "opacity": rates.opacity,
        "colour": rates.colour,
        "turn": rates.turn,
        "quats": rates.turn,
        "stretch": rates.stretch,
        "means": rates.means,
        "vertices": rates.vertices,
        "harmonics": rates.harmonics,
        "exposure_gains": rates.exposure_gains,
        "exposure_offsets": rates.exposure_offsets,
    }
    starts = [steps[name] for name in learned]
    groups = [
        {"params": [value.requires_grad_(True)], "lr": rate} for value, rate in zip(learned.values(), starts, strict=True)
    ]
    return torch.optim.Adam(groups, eps=1e-15, fused=True), starts


def _save(
    path: Path,
    learned: dict[str, Tensor],
    optimizer: torch.optim.Adam,
    step: int,
    curve: list[list[float]],
    recent: list[list[float]],
    inputs: str,
) -> None:
    """Write a checkpoint, whole or not at all."""
    content = {
        "step": step,
        "inputs": inputs,
        "parameters": {name: value.detach() for name, value in learned.items()},
        "optimizer": optimizer.state_dict(),
        "curve": curve,
        "recent": recent,
    }
    # Save through memory: on a full disk, torch's own error would not say that the disk is full.
    buffer = io.BytesIO()
    torch.save(content, buffer)
    with atomic_file(path) as temporary:
        temporary.write_bytes(buffer.getbuffer())


def _resume(
    path: Path, learned: dict[str, Tensor], optimizer: torch.optim.Adam, inputs: str
) -> tuple[int, list[list[float]], list[list[float]]]:
    """Load a checkpoint into parameters and optimizer; return its step, curve and pending losses, or 0 and empty lists."""
    if not path.is_file():
        return 0, [], []
    try:
        content = torch.load(path, weights_only=True)
        saved = content["parameters"]
        fits = {name: value.shape for name, value in saved.items()} == {name: value.shape for name, value in learned.items()}
        if not fits or content["inputs"] != inputs:
            raise ValueError("it belongs to another model")
        optimizer.load_state_dict(content["optimizer"])
    except Exception as error:  # torch raises many kinds for a damaged file; starting anew is always right
        logger.warning("%s is not used (%s); training starts anew", path, error)
        return 0, [], []
    with torch.no_grad():
        for name, value in learned.items():
            value.copy_(saved[name])
    logger.info("training goes on from step %d", content["step"])
    return content["step"], content["curve"], content["recent"]
