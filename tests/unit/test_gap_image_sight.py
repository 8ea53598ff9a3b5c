"""What a displaced camera sees of a wall with a card before it, against rays cast at both."""

from dataclasses import replace

import numpy as np
import pytest

from gsbridge.cameras import Camera
from gsbridge.effects.images.camera_pipeline import Shooting
from gsbridge.gap.image.expect import Expectation
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.visibility import off_steps, seen_from
from gsbridge.images import srgb_from_linear

CAMERA = Camera(128, 96, 110.0, 110.0, 64.0, 48.0)
WALL, CARD = 0.4, 0.2
HALF = 0.03
"""Of the card's edge, m."""


def cast(eye, camera=CAMERA):
    """Light, depth and which thing is seen by a camera at `eye` that looks along z. [H, W, 3], [H, W], [H, W]."""
    rays = camera.pixel_rays()
    near = eye[:2] + rays[..., :2] * (CARD - eye[2])
    on_card = (np.abs(near) < HALF).all(axis=-1)
    depth = np.where(on_card, CARD, WALL) - eye[2]
    place = np.where(on_card[..., None], near, eye[:2] + rays[..., :2] * (WALL - eye[2]))
    waves = np.array([[35.0, 20.0], [-25.0, 30.0], [15.0, 45.0]])
    light = 0.4 + 0.2 * np.sin(place @ waves.T + np.where(on_card, 1.0, 0.0)[..., None])
    return light, depth, on_card


def moved(shift):
    pose = np.eye(4)
    pose[:3, 3] = shift
    return pose


@pytest.mark.parametrize("shift", [(0.012, 0.0, 0.0), (-0.008, 0.01, 0.004), (0.0, 0.0, -0.01)])
def test_nearest_surface_is_seen_and_what_was_hidden_is_not(shift):
    depth, wanted = cast(np.zeros(3))[1], cast(np.array(shift))[1]
    seen = seen_from(depth, CAMERA, moved(-np.array(shift)))
    inner = off_steps(wanted)
    # What the earlier camera saw of the wall: the rest lay behind the card, or beyond its edges.
    rays = CAMERA.pixel_rays()
    wall = np.array(shift)[:2] + rays[..., :2] * (WALL - shift[2])
    hidden = (np.abs(wall * CARD / WALL) < HALF).all(axis=-1) & (wanted > CARD + 0.05)
    edge = CAMERA.pixel_rays()[0, 0, :2] * WALL
    beyond = (np.abs(wall) > np.abs(edge) - 0.004).any(axis=-1)
    clear = inner & ~hidden & ~beyond & (seen > 0)
    assert clear.mean() > 0.5
    assert np.abs(seen - wanted)[clear].max() < 1e-6
    far = np.hypot(shift[0], shift[1]) > 0
    assert hidden.any() == far
    if far:
        # Deep inside what was hidden nothing falls, or the card's own edge, never the wall.
        assert (seen[hidden] == 0).mean() > 0.5


def test_steps_are_kept_off_and_planes_are_not():
    depth = cast(np.zeros(3))[1]
    kept = off_steps(depth)
    near = np.abs(np.diff(depth, axis=1)) > 0.1
    assert not kept[:, 1:][near].any()
    slanted = 1.0 / (2.0 + 0.01 * np.arange(128)[None, :] + np.zeros((96, 1)))
    assert off_steps(slanted).all()
    assert not off_steps(np.zeros((8, 8))).any()


@pytest.mark.parametrize("shift", [(0.012, 0.0, 0.0), (-0.008, 0.01, 0.004)])
def test_expected_photo_is_the_one_cast_from_the_new_place(shift):
    before = srgb_from_linear(cast(np.zeros(3))[0]).astype(np.float32)
    light, _, on_card = cast(np.array(shift))
    after = srgb_from_linear(light).astype(np.float32)
    depth = cast(np.zeros(3))[1]
    stack = [np.stack([photo] * 4) for photo in (before, before, after, depth)]
    pairs = Pairs(CAMERA, stack[0], stack[1], stack[2], stack[3], np.stack([np.eye(4)] * 4), repeats=4)
    expectation = Expectation(pairs)
    how = replace(Shooting(), mount=moved(-np.array(shift)))
    shown = expectation.shown(how)[0]
    apart = np.abs(expectation.photos(how)[0] - after).max(axis=-1)
    assert shown.mean() > 0.5
    assert shown[on_card].any()
    assert apart[shown].max() < 0.02
    if shift[2] == 0:
        # A card whose depth is unknown is left out, wherever it is seen now.
        unknown = np.where(cast(np.zeros(3))[2], 0.0, depth)
        blind = Expectation(replace(pairs, depths=np.stack([unknown] * 4)))
        seen = blind.shown(how)[0]
        assert not seen[on_card].any()
        assert np.abs(blind.photos(how)[0] - after).max(axis=-1)[seen].max() < 0.02
    # Without the earlier depths seen from the new place, what comes into sight would be compared, too.
    wall = np.array(shift)[:2] + CAMERA.pixel_rays()[..., :2] * (WALL - shift[2])
    hidden = (np.abs(wall * CARD / WALL) < HALF).all(axis=-1) & ~on_card
    assert not shown[hidden].any()
