"""Flat scenes are told without a board, in whatever frame and unit a model stands."""

from __future__ import annotations

import numpy as np
import pytest
from posed_scene import LENS, cloud, model_of, moved, orbit

from gsbridge.cameras import Camera
from gsbridge.geometry import Similarity, rotation_between
from gsbridge.sfm.refine import is_flat, is_planar
from gsbridge.sfm.stage import _doubts

TILT = rotation_between(np.array([0.0, 0.0, 1.0]), np.array([0.3, -0.8, 0.2]))


@pytest.mark.parametrize("unit", [1e-3, 1.0, 40.0])
@pytest.mark.parametrize("above", [0, 10, 40, 200])
def test_a_flat_scene_is_told_from_the_model_as_from_the_board(above: int, unit: float) -> None:
    """600 points on the table and some on a box that stands there, with a few that were matched wrongly."""
    wrong = np.random.default_rng(1).uniform([-0.3, -0.3, -0.5], [0.3, 0.3, 0.3], (4, 3))
    model = model_of(LENS, orbit(24), np.r_[cloud(above=above), wrong], noise=0.3)
    elsewhere = moved(model, Similarity(unit, TILT, np.array([5.0, -3.0, 11.0])))
    assert is_planar(elsewhere) == is_flat(model) == (above < 20)


@pytest.mark.parametrize(
    ("refinement", "camera", "said"), [({}, None, True), ({}, LENS, False), ({"flat": False}, None, False)]
)
def test_a_camera_calibrated_from_a_flat_scene_is_doubted_without_a_board(
    refinement: dict, camera: Camera | None, said: bool
) -> None:
    """A named camera is calibrated elsewhere, and where a board measured the heights, it knows them better."""
    model = model_of(LENS, orbit(24), cloud(above=0), noise=0.3)
    reasons = _doubts(model, {"used": False, **refinement}, camera)
    assert [True for reason in reasons if "calibrated from a flat scene alone" in reason] == [True] * said
