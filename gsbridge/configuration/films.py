"""Settings of what the mirror films and photographs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gsbridge.configuration.base import Pixels, Samples, Settings, Sheet, Whole

Film = Literal[
    "small_cube", "cake", "banana", "bear", "foam_pad", "tablecloth", "plate",
    "mug", "bowl", "pot", "statue", "toy", "white_box", "dense_pan",
]  # fmt: skip
"""A scene that the mirror's film studio films."""
Take = Literal["portrait", "turned", "one_height", "re_exposing"]
"""Another way of filming: the phone held upright, pictures stored on their side, a walk at one height, automatic exposure."""
Frames = Annotated[Whole, Field(ge=8, le=2000)]


class FilmSettings(Settings):
    """Size and quality of a film.

    Samples are multi-jittered, so that few go far. Each film's own ceiling is in its record.
    """

    frames: Frames = 56
    """Number of frames, all of which become keyframes."""
    spp: Samples = 16
    """Samples per pixel of a training frame, a square number wastes none of them."""
    held_out_spp: Samples = 64
    """Samples per pixel of the held-out frames."""
    width: Pixels = 640
    """Width of the film, px."""
    height: Pixels = 480
    """Height of the film, px."""
    sheet: Sheet = "a4"
    """Paper size of the board."""


class DenseFilmSettings(FilmSettings):
    """The film of the scene `dense_pan`, which tests the choice of keyframes: five seconds of small video at few samples."""

    frames: Frames = 150
    """Number of frames."""
    spp: Samples = 4
    """Samples per pixel of a frame."""
    held_out_spp: Samples = 4
    """Samples per pixel of the held-out frames."""
    width: Pixels = 320
    """Width of the film, px."""
    height: Pixels = 240
    """Height of the film, px."""


class BoardFilmSettings(Settings):
    """Size of the mirror's photos of the board."""

    poses: Whole = Field(default=14, ge=3, le=200)
    """Poses of the arm."""
    width: Pixels = 640
    """Width of a photo, px."""
    height: Pixels = 480
    """Height of a photo, px."""
    spp: Samples = 9
    """Samples per pixel."""
