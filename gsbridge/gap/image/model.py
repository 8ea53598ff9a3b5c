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
    """An image effect that the simulation may lack."""

    registry = IMAGE_EFFECTS


def image_candidates(names: Collection[str] | None = None) -> tuple[ImageCandidate, ...]:
    """Return all image effects as candidates, or only those in `names`."""
    return tuple(ImageCandidate(name) for name in IMAGE_EFFECTS if names is None or name in names)


def shooting(effects: Sequence[Applied] = (), edge: int = 1) -> Shooting:
    """Build the camera pipeline with some effects.

    Args:
        effects: Effects; image lengths among their parameters are in pixels of the original photos.
        edge: Reduction factor of the images: original pixels along each edge of one reduced pixel.

    Raises:
        InputError: An effect or one of its parameters is unknown, or a value is out of its bounds.
    """
    how = Shooting()
    for applied in read_effects([applied.record() for applied in effects], "model", IMAGE_EFFECTS):
        IMAGE_EFFECTS[applied.name].apply(how, applied.parameters)
    how.blur /= edge**2
    return how
