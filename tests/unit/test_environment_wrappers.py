"""Disturbances: seeded, of the stated strength, without effect at zero; late and lost actions."""

import gymnasium
import numpy as np
import pytest
from environment_fixture import hand_environment

from gsbridge.environment.wrappers import ActionLatency, DroppedActions, ImageJitter, ImageNoise, Jitter, jitter_matrix
from gsbridge.errors import InputError

NONE = Jitter(0, 0, 0, 0, 0)


class Still(gymnasium.Env):
    """Shows one grey level and remembers the actions it was given."""

    def __init__(self, level=100):
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (5,), np.float32)
        image = gymnasium.spaces.Box(0, 255, (64, 64, 3), np.uint8)
        self.observation_space = gymnasium.spaces.Dict({"image": image})
        self.level, self.actions = level, []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return {"image": np.full((64, 64, 3), self.level, np.uint8)}, {}

    def step(self, action):
        self.actions.append(np.array(action))
        return {"image": np.full((64, 64, 3), self.level, np.uint8)}, 0.0, False, False, {}


def images(env, seed, steps=3):
    out = [env.reset(seed=seed)[0]["image"]]
    out += [env.step(np.zeros(5, np.float32))[0]["image"] for _ in range(steps)]
    return np.stack(out)


@pytest.mark.parametrize(
    "make",
    [
        lambda env: ImageNoise(env, 10.0),
        lambda env: ImageJitter(env, Jitter(shift_px=3)),
        lambda env: ImageJitter(env, each_step=True),
        lambda env: DroppedActions(ActionLatency(env, (0, 3)), 0.5),
    ],
)
def test_same_seed_same_disturbance(make):
    env = make(hand_environment())
    first = images(env, 3)
    np.testing.assert_array_equal(images(env, 3), first)
    np.testing.assert_array_equal(images(make(hand_environment()), 3), first)
    assert env.observation_space.contains(env.step(np.zeros(5, np.float32))[0])


def test_zero_strength_changes_nothing():
    plain = images(hand_environment(), 1)
    env = hand_environment()
    for wrap in (
        lambda e: ImageNoise(e, 0.0),
        lambda e: ImageJitter(e, NONE),
        lambda e: ActionLatency(e, (0, 0)),
        lambda e: DroppedActions(e, 0.0),
    ):
        env = wrap(env)
    np.testing.assert_array_equal(images(env, 1), plain)


def test_noise_has_the_stated_spread_and_never_wraps():
    noisy = images(ImageNoise(Still(100), 10.0), 0).astype(float) - 100
    assert noisy.mean() == pytest.approx(0, abs=0.2)
    # Rounding adds a twelfth of a level squared.
    assert noisy.std() == pytest.approx(10.0, rel=0.02)
    assert not np.array_equal(noisy[0], noisy[1])
    for level in (0, 255):
        extreme = images(ImageNoise(Still(level), 20.0), 0).astype(float)
        assert np.abs(extreme - level).max() < 128


def test_jitter_once_an_episode_or_every_step():
    steady = images(ImageJitter(Still()), 5)
    assert (steady == steady[0]).all()
    assert not np.array_equal(steady, images(ImageJitter(Still()), 6))
    fresh = images(ImageJitter(Still(), each_step=True), 5)
    assert len({tuple(image[0, 0]) for image in fresh}) == len(fresh)


def test_jitter_does_to_colours_what_it_says():
    rng = np.random.default_rng(0)
    grey = np.array([80.0, 80.0, 80.0])
    for _ in range(50):
        # Saturation and hue leave grey alone.
        matrix, offset = jitter_matrix(Jitter(0, 0, 0.8, 0, 60), rng)
        np.testing.assert_allclose(matrix @ grey + offset, grey, atol=1e-9)
        matrix, offset = jitter_matrix(Jitter(0.3, 0, 0, 0, 0), rng)
        factor = (matrix @ grey + offset)[0] / 80
        assert 0.7 <= factor <= 1.3
        np.testing.assert_allclose(matrix, factor * np.eye(3), atol=1e-9)
        # Contrast turns about the middle grey.
        matrix, offset = jitter_matrix(Jitter(0, 0.3, 0, 0, 0), rng)
        np.testing.assert_allclose(matrix @ np.full(3, 127.5) + offset, 127.5, atol=1e-9)
        matrix, _ = jitter_matrix(Jitter(0, 0, 0, 0.1, 0), rng)
        assert (np.abs(np.diag(matrix) - 1) <= 0.1).all()


def test_late_actions_arrive_in_order():
    for delay in (0, 2):
        still = Still()
        env = ActionLatency(still, (delay, delay))
        env.reset(seed=0)
        action = np.zeros(5, np.float32)
        for k in range(5):
            action[:] = (k + 1) / 10  # the same array, written again
            env.step(action)
        expected = [0.0] * delay + [(k + 1) / 10 for k in range(5 - delay)]
        np.testing.assert_allclose([a[0] for a in still.actions], expected, atol=1e-7)


def test_lost_actions_are_holds_and_counted():
    still = Still()
    env = DroppedActions(still, 0.3)
    env.reset(seed=1)
    for _ in range(1000):
        env.step(np.ones(5, np.float32))
    lost = sum(not action.any() for action in still.actions)
    assert lost == env.dropped
    # Three standard deviations of a binomial.
    assert lost == pytest.approx(300, abs=45)


def test_action_that_is_no_number_is_refused_through_all_wrappers():
    stacked = DroppedActions(ActionLatency(hand_environment(), (0, 0)), 1.0)
    for env in (stacked, DroppedActions(hand_environment(), 1.0), ActionLatency(hand_environment(), (3, 3))):
        env.reset(seed=0)
        with pytest.raises(InputError, match="not finite"):
            env.step(np.full(5, np.nan, np.float32))


def test_bad_strengths_are_refused():
    for make in (
        lambda: ImageNoise(Still(), -1.0),
        lambda: Jitter(brightness=1.0),
        lambda: Jitter(hue_deg=float("nan")),
        lambda: Jitter(shift_px=17),
        lambda: ActionLatency(Still(), (2, 1)),
        lambda: DroppedActions(Still(), 1.5),
    ):
        with pytest.raises(InputError, match="out of range"):
            make()
