"""Photos with given poses, on a drawn plane."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gsbridge.cameras import Camera, look_at
from gsbridge.configuration.sfm import SfmSettings
from gsbridge.errors import StageError
from gsbridge.images import write_image
from gsbridge.photogrammetry.colmap import quiet
from gsbridge.sfm import gates
from gsbridge.sfm.known_poses import map_posed_photos, triangulate_known
from gsbridge.sfm.photos import Photos

CAMERA = Camera(320, 240, 300.0, 300.0, 160.0, 120.0)


def drawn(folder: Path, called: str, seed: int | None = 0) -> tuple[Photos, dict]:
    """Five photos of a textured plane z = 0, with their cameras and poses; without a seed each shows another texture."""
    texture_from_pixel = np.array([[0.002, 0.0, -0.4], [0.0, -0.002, 0.4], [0.0, 0.0, 1.0]])
    known = {}
    for k in range(5):
        rng = np.random.default_rng(k if seed is None else seed)
        texture = cv2.GaussianBlur((rng.random((400, 400)) * 255).astype(np.uint8), (0, 0), 2)
        texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)  # type: ignore[call-overload]
        pose = look_at((0.3 * np.sin(0.15 * k), -0.3 * np.cos(0.15 * k), 0.6), np.zeros(3))
        # OpenCV counts pixels from the centre of the first, cameras from its corner.
        homography = replace(CAMERA, cx=159.5, cy=119.5).intrinsics @ pose[:3][:, [0, 1, 3]] @ texture_from_pixel
        write_image(folder / called.format(k), cv2.warpPerspective(texture, homography, (320, 240)))
        known[called.format(k)] = (CAMERA, pose)
    return Photos(folder, list(known), False, None, None, (320, 240)), known


@pytest.mark.parametrize("called", ["IMG_{}.png", "IMG {}.png", "#{}.png"])
def test_many_posed_photos_are_triangulated_whatever_their_names(tmp_path: Path, called: str) -> None:
    photos, known = drawn(tmp_path, called)
    (tmp_path / "work").mkdir()
    with quiet(tmp_path / "log"):
        model, _ = triangulate_known(photos, known, SfmSettings(exhaustive_up_to=3), tmp_path / "work", 0, 1)
    heights = np.array([point.xyz[2] for point in model.points3D.values()])
    assert len(heights) > 1000
    assert np.median(np.abs(heights)) < 0.001


def test_posed_photos_of_different_things_are_said_to_have_no_points(tmp_path: Path) -> None:
    photos, known = drawn(tmp_path, "{}.png", seed=None)
    (tmp_path / "work").mkdir()
    with quiet(tmp_path / "log"):
        outcome, _ = map_posed_photos(photos, known, SfmSettings(), tmp_path / "work", 0, 1)
    with pytest.raises(StageError, match=r"5 of 5 images registered \(100 %\), but only \d+ points .* 30 are needed"):
        gates.check(outcome, photos, SfmSettings(), "sfm")
