"""Image effects as candidates of a diagnosis."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.images.camera_pipeline import Shooting
from gsbridge.effects.registry import Applied, read_effects
from gsbridge.gap.diagnosis.results import Candidate


@dataclass(frozen=True, order=True)
class ImageCandidate(Candidate):
    """An image effect that may be missing."""

    registry = IMAGE_EFFECTS


def image_candidates(names: Collection[str] | None = None) -> tuple[ImageCandidate, ...]:
    """All image effects; of these only, if `names` is given."""
    return tuple(ImageCandidate(name) for name in IMAGE_EFFECTS if names is None or name in names)


def shooting(effects: Sequence[Applied] = (), edge: int = 1) -> Shooting:
    """The way photos are taken with some effects.

    Args:
        effects: Effects; lengths in the image are in pixels of the camera.
        edge: Pixels of the camera along each edge of a pixel of the pictures.

    Raises:
        InputError: An effect or one of its parameters is unknown, or a value is out of its bounds.
    """
    how = Shooting()
    for applied in read_effects([applied.record() for applied in effects], "model", IMAGE_EFFECTS):
        IMAGE_EFFECTS[applied.name].apply(how, applied.parameters)
    how.blur /= edge**2
    return how
