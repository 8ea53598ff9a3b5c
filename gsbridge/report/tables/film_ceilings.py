"""What a film says of its own noise: the PSNR that a perfect model would reach against its photos."""

from __future__ import annotations

from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.files import read_json

Ceilings = dict[tuple[str, str], float]


def read_ceilings(film_json: str | Path) -> Ceilings:
    """Noise ceilings of a film's photos, dB.

    Held-out photos are the ones with the most samples per pixel, training photos those with the fewest.

    Args:
        film_json: Record of a film.

    Returns:
        {(split, region): ceiling}; entries that the film does not tell are missing.

    Raises:
        InputError: The record is damaged.
    """
    film = read_json(film_json)
    try:
        samples = [int(frame["spp"]) for frame in film["frames"]]
        chosen = {"held_out": str(max(samples)), "train": str(min(samples))}
        full = film.get("ceiling_db") or {}
        # A background's masked region is the table, which fills its photos: there the ceiling of the whole frame counts.
        masked = film.get("ceiling_masked_db") or (full if film.get("kind") == "background" else {})
        regions = {"masked": masked, "full": full}
        return {
            (split, region): float(ceilings[count])
            for split, count in chosen.items()
            for region, ceilings in regions.items()
            if ceilings.get(count) is not None
        }
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(film_json, f"the film's record is damaged ({error!r})", "Film the scene again") from error
