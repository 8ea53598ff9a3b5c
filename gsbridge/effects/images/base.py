"""Effects of pictures: what they share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from itertools import product
from typing import ClassVar

from gsbridge.effects.base import Effect, Parameter
from gsbridge.effects.images.camera_pipeline import Shooting

__all__ = ["HOOKS", "ImageEffect", "Parameter"]

HOOKS = ("time", "geometry", "light", "sensor")
"""Places where an effect takes hold, on the way from the scene to the file: when and from where the camera looks, through
what geometry, what happens to the linear light, and what the sensor makes of it."""


class ImageEffect(Effect):
    """One thing that pictures of a simulation may lack.

    Attributes:
        places: Values of shape parameters at which one begins to look, all combinations; the typical one where none are given.
        far: Values of some amplitudes, the others being zero, at which one begins to look, too, since from nothing the way to
            what moved that far leads astray.
        noise_only: Whether it changes the noise of the pictures only, not their expectation.
        timed: Whether it depends on when a photo was taken, beyond where the camera was then.
    """

    scope: ClassVar[str] = "camera"
    places: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    far: ClassVar[tuple[Mapping[str, float], ...]] = ()
    noise_only: ClassVar[bool] = False
    timed: ClassVar[bool] = False

    @abstractmethod
    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Put the effect into the way in which photos are taken."""

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        """Parameters that vanish with the effect."""
        return tuple(parameter for parameter in self.parameters if parameter.amplitude)

    def shapes(self) -> tuple[dict[str, float], ...]:
        """Shape parameters at which one begins to look; one empty set for an effect without any."""
        forms = [parameter for parameter in self.parameters if not parameter.amplitude]
        grids = [self.places.get(parameter.name, (parameter.typical,)) for parameter in forms]
        return tuple({p.name: value for p, value in zip(forms, row, strict=True)} for row in product(*grids))

    def directions(self) -> tuple[dict[str, float], ...]:
        """Parameter sets of typical size: each amplitude alone, both ways where both make sense, at every shape."""
        out = []
        for shape in self.shapes():
            rest = {p.name: shape.get(p.name, 0.0) for p in self.parameters}
            for parameter in self.amplitudes:
                for sign in (1.0, -1.0):
                    value = sign * parameter.typical
                    if parameter.low <= value <= parameter.high:
                        out.append(rest | {parameter.name: value})
        return tuple(out)

    def clipped(self, values: Mapping[str, float]) -> dict[str, float]:
        """All parameters within their bounds."""
        return {p.name: min(max(values[p.name], p.low), p.high) for p in self.parameters}
