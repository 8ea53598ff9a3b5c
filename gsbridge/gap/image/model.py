"""Image effects as candidates of a diagnosis."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.joints.candidates import Candidate
from gsbridge.gap.joints.mechanism.mechanism_model import Applied
from gsbridge.scene.effects import catalogue, effect_of
from gsbridge.scene.effects.base import ImageEffect
from gsbridge.scene.shooting import Shooting


@dataclass(frozen=True, order=True)
class ImageCandidate(Candidate):
    """An image effect that may be missing."""

    @property
    def effect(self) -> ImageEffect:  # type: ignore[override]
        """Its entry in the catalogue."""
        return effect_of(self.name)


def image_candidates(names: Collection[str] | None = None) -> tuple[ImageCandidate, ...]:
    """All image effects; of these only, if `names` is given."""
    return tuple(ImageCandidate(name) for name in catalogue() if names is None or name in names)


def shooting(effects: Sequence[Applied] = ()) -> Shooting:
    """How photos are taken with some effects.

    Raises:
        InputError: An effect or one of its parameters is unknown.
    """
    how = Shooting()
    for applied in effects:
        check(applied)
        effect_of(applied.name).apply(how, applied.parameters)
    return how


def check(applied: Applied, source: str = "model") -> None:
    """Whether an effect and its parameters exist, within their bounds.

    Raises:
        InputError: They do not.
    """
    effect = effect_of(applied.name, source)
    wanted: Mapping[str, float] = applied.parameters
    if set(wanted) != {parameter.name for parameter in effect.parameters}:
        known = ", ".join(parameter.name for parameter in effect.parameters)
        raise InputError(source, f"the effect '{applied.name}' has other parameters", f"State exactly: {known}")
    for parameter in effect.parameters:
        if not parameter.low <= wanted[parameter.name] <= parameter.high or not np.isfinite(wanted[parameter.name]):
            raise InputError(
                source,
                f"{applied.name}.{parameter.name} is {wanted[parameter.name]:g} {parameter.unit}",
                f"Keep it between {parameter.low:g} and {parameter.high:g}",
            )
