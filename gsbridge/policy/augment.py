"""Random image attributes and noise for a batch of pictures, and noise on the gripper's opening.

Each picture gets one 3x3 matrix on its colours, an offset, and noise.

Brightness, contrast, saturation, tint and hue are linear in the colours; together they cost one small product per picture.
Pictures are not shifted, since that would change the positions that the soft-argmax extracts.

Source: RL-GSBridge, "we add random noise to the rendered images of the GS model and randomly alter certain image attribute
parameters during training"; brightness, saturation and contrast of its code vary by 0.4, hue by 25 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import torch
from torch import Tensor

from gsbridge.environment.proprioception import OPENING, OPENING_ERROR
from gsbridge.errors import InputError

_BANK = 1 << 18
_BANK_SEED = 20
_GREY = (0.299, 0.587, 0.114)
"""Weights of brightness in RGB (ITU-R BT.601)."""


@dataclass(frozen=True)
class Jitter:
    """Ranges of random image attributes; 0 leaves an attribute alone.

    Args:
        brightness, contrast, saturation: Factors are drawn from 1 - value to 1 + value.
        tint: Each channel's factor is drawn from 1 - value to 1 + value.
        hue_deg: Turn of the colours about grey, from -value to value.
    """

    brightness: float = 0.3
    contrast: float = 0.3
    saturation: float = 0.3
    tint: float = 0.1
    hue_deg: float = 10.0

    def __post_init__(self) -> None:
        for name in ("brightness", "contrast", "saturation", "tint"):
            _within(f"jitter: {name}", getattr(self, name), 0.0, 0.95)
        _within("jitter: hue_deg", self.hue_deg, 0.0, 180.0)


@dataclass(frozen=True)
class Augmentation:
    """Ranges of the random changes.

    Args:
        jitter: Ranges of the attributes.
        offset: Each channel is shifted by -value to value, as a share of a picture's range.
        noise: Largest standard deviation of the noise, as a share of a picture's range; each picture draws its own from 0 on.
        opening: Standard deviations of noise on the two entries of `proprio` that tell the opening, in their units: about 3 mm,
            the largest error of a reconstructed object's width.

    Raises:
        InputError: A range makes no sense.
    """

    jitter: Jitter = field(default_factory=lambda: Jitter(brightness=0.4, contrast=0.4, saturation=0.4, tint=0.15))
    offset: float = 0.04
    noise: float = 0.03
    opening: tuple[float, float] = (0.02, 0.07)

    def __post_init__(self) -> None:
        if not (0.0 <= self.offset <= 0.5 and 0.0 <= self.noise <= 0.5):
            raise InputError("augmentation", f"offset {self.offset} or noise {self.noise} is out of range", "Give 0 to 0.5")
        if not (len(self.opening) == 2 and all(0.0 <= value <= 1.0 for value in self.opening)):
            raise InputError("augmentation: opening", f"{self.opening} is out of range", "Give two numbers from 0 to 1")

    def widened(self, factor: float) -> Augmentation:
        """Augmentation with all ranges of pictures multiplied by a factor; `opening` stays."""
        jitter = Jitter(**{item.name: factor * getattr(self.jitter, item.name) for item in fields(self.jitter)})
        return replace(self, jitter=jitter, offset=factor * self.offset, noise=factor * self.noise)


class Augmenter:
    """Varies batches of pictures.

    Args:
        settings: Ranges.
        device: Device of the pictures.
    """

    def __init__(self, settings: Augmentation | None = None, device: str = "cpu") -> None:
        self.settings = settings or Augmentation()
        # Drawing noise for every value takes longer than the encoder, so each picture takes a random run of a fixed bank.
        bank = torch.randn(_BANK, generator=torch.Generator().manual_seed(_BANK_SEED))
        self._bank = bank.to(device)

    def __call__(self, pictures: Tensor, generator: torch.Generator) -> Tensor:
        """Return pictures with random attributes and noise.

        Args:
            pictures: -0.5..0.5, [B, 3, H, W], channels last.
            generator: CPU generator of all random numbers.

        Returns:
            -0.5..0.5, [B, 3, H, W], channels last.
        """
        count, _, height, width = pictures.shape
        matrix, offset = colour_maps(self.settings, count, generator)
        matrix, offset = matrix.to(pictures.device), offset.to(pictures.device)
        # Planar colours: although they cost a copy each way, the product is ten times faster than on interleaved ones.
        out = torch.baddbmm(offset[:, :, None], matrix, pictures.contiguous().reshape(count, 3, height * width))
        if self.settings.noise > 0:
            size = height * width * 3
            sigma = self.settings.noise * torch.rand(count, 1, generator=generator)
            starts = torch.randint(_BANK - size, (count,), generator=generator)
            runs = torch.stack([self._bank[start : start + size] for start in starts.tolist()])
            out = out.reshape(count, size).addcmul_(runs, sigma.to(out.device))
        return out.clamp_(-0.5, 0.5).reshape(pictures.shape).contiguous(memory_format=torch.channels_last)

    def feel(self, proprio: Tensor, generator: torch.Generator) -> Tensor:
        """Add noise to the opening, so that fingers closed on an object of another width do not look as if they still moved.

        Args:
            proprio: Proprioception. [B, 12].
            generator: CPU generator.

        Returns:
            [B, 12].
        """
        noise = torch.randn(len(proprio), 2, generator=generator) * torch.tensor(self.settings.opening)
        out = proprio.clone()
        out[:, [OPENING, OPENING_ERROR]] += noise.to(out.device)
        return out


def colour_maps(settings: Augmentation, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Draw the colour map of each picture: `out = matrix @ rgb + offset` on values -0.5..0.5.

    Args:
        settings: Ranges.
        count: Pictures, B.
        generator: CPU generator.

    Returns:
        [B, 3, 3] and [B, 3]; the identity and zeros where every range is zero.
    """
    jitter = settings.jitter
    ranges = torch.tensor([jitter.brightness, jitter.contrast, jitter.saturation, *[jitter.tint] * 3])
    factors = 1.0 + ranges * (2.0 * torch.rand(count, 6, generator=generator) - 1.0)
    brightness, contrast, saturation, tint = factors[:, 0], factors[:, 1], factors[:, 2], factors[:, 3:]
    angle = torch.deg2rad(torch.tensor(jitter.hue_deg)) * (2.0 * torch.rand(count, generator=generator) - 1.0)
    eye, grey = torch.eye(3), torch.tensor(_GREY).expand(3, 3)
    side = 3.0**-0.5
    cross = side * torch.tensor([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]])
    sine, cosine = torch.sin(angle)[:, None, None], torch.cos(angle)[:, None, None]
    # Rodrigues' formula: a turn about the grey diagonal of the colour cube.
    turn = eye + sine * cross + (1.0 - cosine) * cross @ cross
    colours = turn @ (saturation[:, None, None] * eye + (1.0 - saturation[:, None, None]) * grey)
    # Contrast is about the middle grey, brightness about black, which is -0.5 here.
    matrix = (brightness * contrast)[:, None, None] * tint[:, :, None] * colours
    black = torch.full((3,), 0.5)
    shift = settings.offset * (2.0 * torch.rand(count, 3, generator=generator) - 1.0)
    offset = (matrix @ black) + 0.5 * (1.0 - contrast)[:, None] - 0.5 + shift
    return matrix, offset


def _within(name: str, value: float, low: float, high: float) -> float:
    """A number within bounds.

    Raises:
        InputError: It is not.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InputError(name, f"{value!r} is out of range", f"Give {low:g} to {high:g}")
    return value
