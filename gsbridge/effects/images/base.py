"""The base class of effects on camera images."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from itertools import product
from typing import ClassVar

from gsbridge.effects.base import Effect, Parameter
from gsbridge.effects.images.camera_pipeline import Shooting

__all__ = ["HOOKS", "ImageEffect", "Parameter"]

HOOKS = ("time", "geometry", "light", "sensor")
"""Stages at which an effect can act, on the way from the scene to the file: time and pose of the exposure, geometry of the
projection, linear light, and sensor values."""


class ImageEffect(Effect):
    """An effect that simulated camera images may lack.

    Attributes:
        places: Starting values of shape parameters; a search tries all combinations. A shape parameter without an entry starts
            at its typical value.
        far: Further starting points of a search: values of some amplitudes, the others being zero. A search from zero ends in
            a wrong local minimum if the images have moved that far.
        noise_only: Whether the effect changes only the noise of the images, not their expected values.
        timed: Whether the effect depends on the time stamp of a photo itself, not only on the camera's pose at that time.
    """

    scope: ClassVar[str] = "camera"
    places: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    far: ClassVar[tuple[Mapping[str, float], ...]] = ()
    noise_only: ClassVar[bool] = False
    timed: ClassVar[bool] = False

    @abstractmethod
    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Add the effect to a `Shooting`, which is changed in place; `values` holds one value per parameter."""

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        """The parameters that are amplitudes: zero where there is no effect."""
        return tuple(parameter for parameter in self.parameters if parameter.amplitude)

    def shapes(self) -> tuple[dict[str, float], ...]:
        """Return all combinations of starting values of the shape parameters; one empty set if there are none."""
        forms = [parameter for parameter in self.parameters if not parameter.amplitude]
        grids = [self.places.get(parameter.name, (parameter.typical,)) for parameter in forms]
        return tuple({p.name: value for p, value in zip(forms, row, strict=True)} for row in product(*grids))

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return each amplitude alone at its typical size, with each sign that its bounds allow, for every start shape."""
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
        """Clip all parameters to their bounds."""
        return {p.name: min(max(values[p.name], p.low), p.high) for p in self.parameters}
