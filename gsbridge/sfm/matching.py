"""The choice of image pairs to match, and their matching."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

import cv2  # noqa: F401  (must be loaded before pycolmap)
import pycolmap

from gsbridge.configuration.sfm import SfmSettings
from gsbridge.sfm.photos import Photos

logger = logging.getLogger("gsbridge")


def ring(names: Sequence[str], overlap: int) -> list[tuple[str, str]]:
    """Pairs of names that are at most `overlap` or a power of two apart on a ring, in which the first name follows the last."""
    count = len(names)
    powers = [1 << k for k in range(count.bit_length()) if 1 << k > overlap]
    steps = [step for step in (*range(1, overlap + 1), *powers) if 2 * step <= count]
    # At a step of half the ring, every pair would come twice.
    pairs = [(i, (i + step) % count) for step in steps for i in range(count if 2 * step < count else step)]
    return [(names[a], names[b]) for a, b in sorted((min(pair), max(pair)) for pair in pairs)]


def can_be_listed(names: Sequence[str]) -> bool:
    """Whether pairs of these images can be listed for COLMAP: in its list a name ends at a blank, and `#` begins a remark."""
    return all(name.split() == [name] and not name.startswith("#") for name in names)


def match(database: Path, photos: Photos, settings: SfmSettings, seed: int, threads: int, *, exhaustive: bool) -> None:
    """Match and verify pairs of images; pairs matched before are kept.

    Args:
        database: Features of all photos.
        photos: Photos that are neighbours on the path of an ordered capture are matched; an unordered capture counts as a ring.
        settings: Gives the number of neighbours.
        seed: Random seed.
        threads: Threads to use; matches do not depend on them.
        exhaustive: Match all pairs instead; photos of an unordered capture whose names cannot be listed need that.
    """
    logger.info("match images, %s", "exhaustive" if exhaustive else f"{settings.overlap} neighbours and powers of two")
    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    matching.num_threads = threads
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    if exhaustive:
        pycolmap.match_exhaustive(
            database, matching_options=matching, verification_options=verification, device=pycolmap.Device.cpu
        )
        return
    if not photos.ordered:
        pairs = database.with_suffix(".pairs")
        pairs.write_text("".join(f"{a} {b}\n" for a, b in ring(photos.names, settings.overlap)), encoding="utf-8")
        imported = pycolmap.ImportedPairingOptions()
        imported.match_list_path = pairs
        pycolmap.match_image_pairs(
            database,
            matching_options=matching,
            pairing_options=imported,
            verification_options=verification,
            device=pycolmap.Device.cpu,
        )
        return
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = settings.overlap
    pairing.quadratic_overlap = True
    pairing.num_threads = threads
    pycolmap.match_sequential(
        database,
        matching_options=matching,
        pairing_options=pairing,
        verification_options=verification,
        device=pycolmap.Device.cpu,
    )
