"""LPIPS, the perceptual distance in the paper's table, with weights from a file of the user; nothing is downloaded.

Source: Zhang et al., CVPR 2018 (version 0.1, VGG-16); layer numbers as in torchvision's `vgg16().features`.
"""

from __future__ import annotations

import re
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from gsbridge.errors import InputError
from gsbridge.geometry import Array

BLOCKS = ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28))
"""Layer numbers of each block's convolutions. Features are taken after the last one of a block; pooling separates blocks."""

SHIFT = (-0.030, -0.088, -0.188)
SCALE = (0.458, 0.448, 0.450)
"""Channel normalisation of images in -1..1."""

_CONVOLUTION = re.compile(r"(?:^|\.)(?:features|slice\d)\.(\d+)\.(weight|bias)$")
_LINEAR = re.compile(r"(?:^|\.)lin(\d)\.model\.1\.weight$")


class Lpips:
    """The LPIPS distance with its weights.

    Args:
        path: File of a mapping, written by `torch.save`, with VGG-16's convolutions (`features.0.weight` … or, as in a saved
            LPIPS model, `net.slice1.0.weight` …) and LPIPS's linear layers (`lin0.model.1.weight` …).

    Raises:
        InputError: The file is missing, damaged or incomplete.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            content = torch.load(path, map_location="cpu", weights_only=True)
            named = {name: value.float() for name, value in content.items()}
        except FileNotFoundError as error:
            raise InputError(
                path,
                "the LPIPS weights do not exist",
                "Correct lpips_weights of object_splats or background_splats, or set it to null",
            ) from error
        except Exception as error:  # torch raises many kinds for damaged files; the user needs one clear line
            raise InputError(
                path, f"the LPIPS weights cannot be read ({error})", "Save them again, or set it to null"
            ) from error
        self._convolutions: dict[tuple[int, str], Tensor] = {}
        self._linears: dict[int, Tensor] = {}
        for name, value in named.items():
            if match := _CONVOLUTION.search(name):
                self._convolutions[int(match[1]), match[2]] = value
            elif match := _LINEAR.search(name):
                self._linears[int(match[1])] = value
        needed = [(layer, part) for block in BLOCKS for layer in block for part in ("weight", "bias")]
        if any(key not in self._convolutions for key in needed) or any(k not in self._linears for k in range(len(BLOCKS))):
            raise InputError(
                path,
                "layers of VGG-16 or of LPIPS are missing",
                "The file needs features.0 … features.28 and lin0 … lin4; see docs/splats.md",
            )

    def _features(self, image: Array) -> list[Tensor]:
        """Return the unit feature vectors of each block. [1, C, h, w] each."""
        x = torch.as_tensor(image, dtype=torch.float32).permute(2, 0, 1)[None] * 2 - 1
        x = (x - torch.tensor(SHIFT).view(1, 3, 1, 1)) / torch.tensor(SCALE).view(1, 3, 1, 1)
        out = []
        for number, block in enumerate(BLOCKS):
            if number > 0:
                x = functional.max_pool2d(x, 2)
            for layer in block:
                weight, bias = self._convolutions[layer, "weight"], self._convolutions[layer, "bias"]
                x = functional.relu(functional.conv2d(x, weight, bias, padding=1))
            out.append(x / (x.square().sum(1, keepdim=True).sqrt() + 1e-10))
        return out

    def __call__(self, image: Array, reference: Array) -> float:
        """Return the distance between two images, 0..1 RGB, at least 16 px on each side. [H, W, 3] each."""
        with torch.no_grad():
            pairs = zip(self._features(image), self._features(reference), strict=True)
            terms = [
                functional.conv2d((a - b).square(), self._linears[number].view(1, -1, 1, 1)).mean()
                for number, (a, b) in enumerate(pairs)
            ]
        return float(torch.stack(terms).sum())
