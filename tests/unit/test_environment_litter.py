"""Flat things in pictures of a training, against projection by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_environment_build import SETTINGS, files  # noqa: F401  (a fixture)

from gsbridge.cameras import look_at
from gsbridge.configuration.policy import PolicySettings
from gsbridge.environment.build import build_environment
from gsbridge.environment.litter import FlatThing, Litter, lay
from gsbridge.environment.rendering import wrist_camera
from gsbridge.errors import InputError
from gsbridge.policy import stage
from gsbridge.tasks.poses import KeepOut, StartRegion

RED, BLUE, GREY = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9), 0.5
CAMERA = wrist_camera(64)
POSE = look_at([0.05, 0.1, 0.35], [0.0, 0.265, 0.0])
PALETTE = np.array([[0.8, 0.7, 0.1], [0.5, 0.4, 0.1]])
CARD = FlatThing(0.02, 0.27, 0.6, 0.04, 0.02, False, np.array([RED, BLUE]))


def table(height=0.0):
    """Depth of a plane over the table as the rasteriser gives it, with half of its splats' opacity. [64, 64] each."""
    across = (np.arange(64) + 0.5 - CAMERA.cx) / CAMERA.fx
    rays = np.stack([*np.meshgrid(across, across), np.ones((64, 64))], axis=-1) @ POSE[:3, :3]
    eye = -POSE[:3, :3].T @ POSE[:3, 3]
    alphas = np.full((64, 64), 0.8, np.float32)
    return ((height - eye[2]) / rays[..., 2] * alphas).astype(np.float32), alphas


NOWHERE = np.eye(4), (np.full(3, 5.0), np.full(3, 6.0))
"""Pose and box of an object that is not in the picture."""


def drawn(things, height=0.0, item=NOWHERE):
    image = np.full((64, 64, 3), GREY, np.float32)
    lay(things, image, *table(height), CAMERA, POSE, *item)
    return image


def pixel(x, y):
    """Row and column of a point of the table."""
    u, v = CAMERA.project((POSE[:3, :3] @ [x, y, 0.0] + POSE[:3, 3])[None])[0]
    return int(v), int(u)


@pytest.mark.parametrize(
    ("along", "aside", "colour"), [(0.02, 0.0, BLUE), (-0.02, 0.0, RED), (0.06, 0.0, None), (0.0, 0.04, None)]
)
def test_a_card_is_seen_where_projection_says(along, aside, colour):
    cosine, sine = np.cos(CARD.turn), np.sin(CARD.turn)
    place = pixel(CARD.x + cosine * along - sine * aside, CARD.y + sine * along + cosine * aside)
    np.testing.assert_allclose(drawn([CARD])[place], [GREY] * 3 if colour is None else colour, atol=1e-6)


def test_areas_are_those_of_the_shapes():
    """An ellipse covers a quarter of pi of its rectangle, both seen from straight above."""
    above = look_at([0.0, 0.265, 0.3], [0.0, 0.2651, 0.0])
    shares = []
    for thing in (replace(CARD, x=0.0), replace(CARD, x=0.0, round=True)):
        image = np.full((64, 64, 3), GREY, np.float32)
        lay([thing], image, np.full((64, 64), 0.3, np.float32), np.ones((64, 64), np.float32), CAMERA, above, *NOWHERE)
        shares.append(float((np.abs(image - GREY) / 0.4).mean(axis=-1).sum()) * (0.3 / CAMERA.fx) ** 2)
    assert shares[0] == pytest.approx(4 * CARD.length * CARD.width, rel=0.03)
    assert shares[1] / shares[0] == pytest.approx(np.pi / 4, rel=0.03)


def test_what_stands_on_the_table_hides_it():
    np.testing.assert_array_equal(drawn([CARD], height=0.03), np.full((64, 64, 3), GREY, np.float32))
    assert (drawn([CARD], height=0.004) != GREY).any()


def test_the_foot_of_an_object_stays_whole():
    """A turned object whose foot stands on the card: the card is seen beside its box, not on it."""
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]]
    pose[:2, 3] = CARD.x, CARD.y
    box = np.array([-0.02, -0.01, 0.0]), np.array([0.02, 0.01, 0.05])
    for height in (0.001, 0.008):
        changed = (drawn([CARD], height, (pose, box)) != GREY).any(axis=-1)
        assert changed.any()
        assert not changed[pixel(CARD.x, CARD.y)]
        assert changed.sum() < (drawn([CARD], height) != GREY).any(axis=-1).sum()


def test_nothing_lies_over_the_horizon():
    """A camera that looks up, at a room of which nothing is drawn."""
    image = np.full((64, 64, 3), GREY, np.float32)
    lay([CARD], image, np.zeros((64, 64)), np.zeros((64, 64)), CAMERA, look_at([0.0, 0.0, 0.2], [0.0, 0.3, 0.5]), *NOWHERE)
    np.testing.assert_array_equal(image, np.full((64, 64, 3), GREY, np.float32))


@given(st.integers(0, 2**32 - 1), st.floats(-0.15, 0.15), st.floats(0.12, 0.41))
def test_things_lie_in_the_square_and_not_under_the_object(seed, x, y):
    litter = Litter(4, PALETTE, StartRegion(keep_out=(KeepOut(0.0, 0.265, 0.1),)))
    things = litter.scattered(np.random.default_rng(seed), np.array([x, y]))
    assert len(things) <= 4
    for thing in things:
        assert max(abs(thing.x), abs(thing.y - 0.265)) <= 0.15
        assert np.hypot(thing.x - x, thing.y - y) - thing.length > 0.03
        assert np.hypot(thing.x, thing.y - 0.265) >= 0.1
        assert 0.0 < thing.width <= thing.length
        assert (thing.colours >= 0.0).all()
        assert (thing.colours <= 1.0).all()


def test_an_episode_has_its_own_litter_and_moves_as_without(files):  # noqa: F811
    made, _ = files
    plain, littered = build_environment(made, SETTINGS), build_environment(made, SETTINGS, litter=4)
    numbers, painted = set(), 0
    for seed in range(6):
        bare, _ = plain.reset(seed=seed)
        shown, info = littered.reset(seed=seed)
        numbers.add(len(littered.eye.renderer.lying))
        changed = (bare["image"] != shown["image"]).any(axis=-1)
        assert changed.any() <= bool(littered.eye.renderer.lying)
        painted += bool(changed.any())
        again, _ = littered.reset(seed=seed)
        np.testing.assert_array_equal(again["image"], shown["image"])
        moved = [environment.step(np.array([0.2, -0.1, -0.4, 0.1, 0.0]))[-1]["state"] for environment in (plain, littered)]
        np.testing.assert_array_equal(*[state["tool_position"] for state in moved])
        np.testing.assert_array_equal(info["start_pose"], plain.start_pose)
    assert len(numbers) > 1
    assert painted > 1
    # Its colours in one colour are the object's one, or any.
    own = littered.eye.litter.palette
    assert own.shape == (1, 3)
    for environment in (plain, littered):
        environment.close()


@pytest.mark.parametrize(("litter", "augment"), [(6, True), (2, False), (0, True)])
def test_a_training_hands_its_litter_on_whether_colours_vary_or_not(litter, augment, monkeypatch, tmp_path):
    handed = []

    def build(made, settings, *, litter, latency):
        handed.append((litter, latency))
        raise InputError("environment", "it was asked for", "That is all")

    monkeypatch.setattr(stage, "build_environment", build)
    settings = PolicySettings(litter=litter, augment=augment, latency=0.01 * litter)
    with pytest.raises(InputError, match="asked for"):
        stage.train_policy(None, SETTINGS, settings, tmp_path, tmp_path / "record.json", seed=1, state=tmp_path / "state")
    assert handed == [(litter, 0.01 * litter)]
