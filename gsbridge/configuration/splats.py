"""Settings of the splats."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gsbridge.configuration.base import Number, OrNull, Positive, Settings, Share, Whole


class SplatSettings(Settings):
    """What a training of splats may cost and how it learns."""

    max_splats: Annotated[Whole, Field(ge=100, le=100_000_000)] | Literal["auto"] = 12_000
    """Upper limit of the number of splats; `auto` follows the pixels and the texture that the photos show (docs/splats.md)."""
    most_splats: Whole = Field(default=60_000, ge=100, le=100_000_000)
    """Upper limit of what `max_splats: auto` chooses."""
    splats_per_face: Whole = Field(default=1, ge=1, le=100)
    """Splats on each face; the mesh is remeshed to meet the limit."""
    sh_degree: Whole = Field(default=0, ge=0, le=3)
    """Degree of the spherical harmonics of colours: 0 for one colour from all sides, 1 to 3 for sheen (docs/splats.md)."""
    exposure: Literal["auto", "locked", "per_photo"] = "auto"
    """`per_photo` fits exposure and white balance of each photo, for films of a camera that re-exposed; `auto` does so where
    photos of the same places differ in brightness, `locked` never (docs/splats.md)."""
    steps: Whole = Field(default=2000, ge=1, le=10_000_000)
    """Optimiser steps, one photo each."""
    max_pixels: Whole = Field(default=80_000, ge=1, le=1_000_000_000)
    """Pixels of a photo, or of an object's part of it, in training; larger ones are reduced. Metrics are not."""
    half_size: Share = 0.0
    """Share of the steps, at the beginning, that use photos of half the size."""
    offset_band: Annotated[Positive, Field(le=1)] | Literal["scene"] = 0.010
    """Largest offset along the normal, m; `scene` for one unit of the reconstruction, as the paper's code."""
    offset_penalty: Number = Field(default=0.0, ge=0)
    """Weight of the mean squared relative offset in the loss."""
    ssim_weight: Share = 0.2
    """Weight of 1 - SSIM in the loss, 0..1; the rest of the weight is on L1."""
    margin_px: Whole = Field(default=12, ge=0, le=1000)
    """Pixels around an object's mask that training looks at."""
    decay: Positive = Field(default=0.1, le=1)
    """Step sizes at the end, relative to the start (exponential)."""
    lpips_weights: OrNull[str] = None
    """File with the weights of LPIPS (docs/splats.md), or null; relative to the directory snakemake runs in."""
    focus: Number = Field(default=16.0, ge=1, le=1000)
    """Factor by which the triangles of a background are sized for finer detail in the square where the robot works than its
    photos show, since the wrist camera looks from nearer. 1 sizes them by the photos alone (docs/splats.md)."""
    focus_centre: tuple[Number, Number] = (0.0, 0.265)
    """Middle of that square, table frame, m."""
    focus_side: Positive = Field(default=0.45, le=5)
    """Edge of that square, m."""
    pictures: Whole = Field(default=4, ge=0, le=1000)
    """Held-out views that are stored as pictures."""
    backend: Literal["cpu", "cuda", "reference"] = "cpu"
    """Rasteriser of the training: `cpu`, or `cuda` where a GPU and gsplat are; `reference` is slow, and for tests."""
