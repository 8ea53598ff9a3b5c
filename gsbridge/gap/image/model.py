"""What should look like the photos: splats, a camera, and the effects added to them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.gap.candidates import Candidate
from gsbridge.gap.image.shots import Shots
from gsbridge.gap.system import Applied
from gsbridge.geometry import Array
from gsbridge.scene.effects import catalogue, effect_of
from gsbridge.scene.effects.base import ImageEffect
from gsbridge.scene.photograph import Photographer
from gsbridge.scene.shooting import Shooting
from gsbridge.splats.cloud import Cloud


@dataclass(frozen=True, order=True)
class ImageCandidate(Candidate):
    """An image effect that may be missing."""

    @property
    def effect(self) -> ImageEffect:  # type: ignore[override]
        """Its entry in the catalogue."""
        return effect_of(self.name)


def image_candidates(names: Sequence[str] | None = None) -> tuple[ImageCandidate, ...]:
    """All image effects; of these only, if `names` is given."""
    return tuple(ImageCandidate(name) for name in catalogue() if names is None or name in names)


@dataclass(frozen=True, eq=False)
class ImageModel:
    """A scene and its camera as they are simulated.

    Args:
        cloud: Splats, world frame.
        camera: Pinhole.
        background: sRGB where there are no splats.
        effects: What was added.
    """

    cloud: Cloud
    camera: Camera
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    effects: tuple[Applied, ...] = ()
    photographer: Photographer = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "photographer", Photographer(self.cloud, self.camera, self.background))

    def digest(self) -> str:
        """SHA-256 over everything that pictures depend on."""
        cloud = self.cloud
        parts = b"".join(getattr(cloud, name).tobytes() for name in ("means", "quats", "scales", "opacities", "colours"))
        text = json.dumps([self.camera.to_json(), self.background, [effect.record() for effect in self.effects]])
        return hashlib.sha256(parts + text.encode()).hexdigest()

    def shooting(self, effects: Sequence[Applied] = (), softness: tuple[float, ...] = ()) -> Shooting:
        """How photos are taken with the model's own effects and further ones.

        Raises:
            InputError: An effect or one of its parameters is unknown.
        """
        how = Shooting(softness=softness)
        for applied in (*self.effects, *effects):
            check(applied)
            effect_of(applied.name).apply(how, applied.parameters)
        return how

    def expected(self, shots: Shots, how: Shooting) -> Array:
        """Pictures where and when some photos were taken. [N, H, W, 3]."""
        return self.photographer.photos(shots.track, shots.times, how)


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
