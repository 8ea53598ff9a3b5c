"""The environment on a world without physics: gymnasium's rules, repeatability, counting, refusals, settings."""

from functools import partial

import gymnasium
import numpy as np
import pytest
from environment_fixture import PLATE, HandWorld, hand_environment
from gymnasium.utils.env_checker import check_env

from gsbridge.environment.env import PickEnvironment, state_of
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.errors import InputError
from gsbridge.tasks.poses import pose_set


def rollout(env, seed: int, steps: int = 12):
    """Observations and rewards of a seeded episode with seeded actions."""
    actions = np.random.default_rng(seed).uniform(-1, 1, (steps, 5)).astype(np.float32)
    seen = [env.reset(seed=seed)[0]]
    rewards = []
    for action in actions:
        observation, reward, *_ = env.step(action)
        seen.append(observation)
        rewards.append(reward)
    return np.stack([o["image"] for o in seen]), np.stack([o["proprio"] for o in seen]), rewards


@pytest.mark.filterwarnings("error")
@pytest.mark.filterwarnings("ignore:.*not initialized via.*")
@pytest.mark.parametrize("task", ["grasp", "pick_and_place"])
def test_gymnasium_accepts_it(task):
    check_env(hand_environment(task=task, plate=PLATE), skip_render_check=True)


def test_same_seed_and_actions_same_observations_bit_by_bit():
    env = hand_environment()
    first = rollout(env, 7)
    rollout(env, 8)
    for again in (rollout(env, 7), rollout(hand_environment(), 7)):
        for a, b in zip(first, again, strict=True):
            np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first[1], rollout(env, 9)[1])


def test_object_is_seen_in_info_only_and_state_comes_back():
    env = hand_environment()
    observation, info = env.reset(seed=1, options={"pose": [0.05, 0.2, 0.3]})
    assert set(observation) == {"image", "proprio"}
    moved, other = env.reset(seed=1, options={"pose": [-0.05, 0.3, -0.3]})
    np.testing.assert_array_equal(observation["proprio"], moved["proprio"])
    state = state_of(info)
    assert len(state) == 1
    np.testing.assert_allclose(state.object_position[0], [0.05, 0.2, 0.0])
    np.testing.assert_allclose(state_of(other).object_position[0], [-0.05, 0.3, 0.0])
    assert state.finite().all()


def test_proprio_says_where_the_tool_is_and_how_far_the_command():
    env = hand_environment(lag=2)
    observation, _ = env.reset(seed=0)
    # The middle of the workspace is (0, 0.265, 0.1925); its half height 0.1575.
    expected = [0, 0, (0.25 - 0.1925) / 0.1575, 0, 1, 1, 0, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(observation["proprio"], expected, atol=1e-6)
    observation = env.step(np.array([1.0, 0.0, -0.5, 1.0, -1.0]))[0]
    # Nothing has moved but the fingers, 7.5 of the 42 mm they were asked for... two steps later.
    np.testing.assert_allclose(observation["proprio"][6:], [1, 0, -0.5, 1, -1, 0], atol=1e-6)
    for _ in range(2):
        observation = env.step(np.zeros(5))[0]
    np.testing.assert_allclose(observation["proprio"][3:5], [np.sin(0.15), np.cos(0.15)], atol=1e-6)
    np.testing.assert_allclose(observation["proprio"][6:10], 0, atol=1e-6)
    np.testing.assert_allclose(observation["proprio"][0], 0.024 / 0.17, atol=1e-6)
    assert observation["proprio"].dtype == np.float32


def test_start_poses_by_name_and_at_random():
    env = hand_environment()
    for name in ("fixed", "unseen"):
        expected = pose_set(name, env.region)
        for index in (0, 31):
            info = env.reset(options={"pose_set": name, "index": index})[1]
            np.testing.assert_array_equal(info["start_pose"], expected[index])
    # A named pose does not shift the random ones after it.
    env.reset(seed=3)
    after = env.reset()[1]["start_pose"]
    env.reset(seed=3, options={"pose_set": "fixed", "index": 4})
    np.testing.assert_array_equal(env.reset()[1]["start_pose"], after)
    drawn = np.array([env.reset()[1]["start_pose"] for _ in range(200)])
    assert env.region.contains(drawn[:, :2]).all()
    assert np.abs(np.bincount(env.region.quadrant(drawn[:, :2]), minlength=5)[1:] - 50).max() < 25
    keep = hand_environment(task="pick_and_place", plate=PLATE)
    places = np.array([keep.reset(seed=seed)[1]["start_pose"] for seed in range(50)])
    assert (np.hypot(places[:, 0] - PLATE.x, places[:, 1] - PLATE.y) >= PLATE.keep_out).all()


@pytest.mark.parametrize(
    "options",
    [
        {"pose": [0, 0]},
        {"pose": [0, np.nan, 0]},
        {"pose": [5, 5, 0]},
        {"pose": [0.0, 0.45, 0]},
        {"pose_set": "fixed"},
        {"index": 3},
        {"pose_set": "other", "index": 0},
        {"pose_set": "fixed", "index": 32},
        {"pose_set": "fixed", "index": True},
        {"pose": [0, 0.265, 0], "index": 1},
        {"place": 1},
    ],
)
def test_options_that_make_no_pose_are_refused(options):
    with pytest.raises(InputError, match="reset options"):
        hand_environment().reset(options=options)


def test_commands_are_cut_and_counted_and_bad_ones_refused():
    env = hand_environment()
    env.reset(seed=0)
    for _ in range(20):
        info = env.step(np.array([1.0, 0, 0, 0, 0]))[4]
    # 0.17 m to the wall are seven whole steps; the eighth and all after it are cut.
    assert info["clipped"] == 13
    assert info["target"]["position"][0] == pytest.approx(0.17)
    assert info["saturated"] == 0
    assert env.step(np.array([0, 0, 0, 0, 3.0]))[4]["saturated"] == 1
    for bad in (np.full(5, np.nan), np.array([0, 0, np.inf, 0, 0]), np.zeros(4), np.zeros((1, 5))):
        with pytest.raises(InputError, match="action"):
            env.step(bad)
    assert env.reset()[1]["clipped"] == 0


def test_episodes_end_by_time_out_and_when_the_world_breaks_down():
    env = hand_environment(max_steps=5)
    env.reset(seed=0)
    ends = [env.step(np.zeros(5))[2:4] for _ in range(5)]
    assert ends == [(False, False)] * 4 + [(False, True)]
    env.reset()
    env.world.broken = True
    observation, reward, terminated, truncated, info = env.step(np.zeros(5))
    assert (reward, terminated, truncated, info["failure"]) == (0.0, True, False, "not_finite")
    assert env.observation_space.contains(observation)


def test_vector_environment_with_a_process_each():
    makers = [partial(hand_environment, max_steps=50)] * 2
    with_processes = gymnasium.vector.AsyncVectorEnv(makers)
    try:
        observation, info = with_processes.reset(seed=[4, 5])
        assert observation["image"].shape == (2, 64, 64, 3)
        states = state_of(info)
        assert len(states) == 2
        observation, _, _, _, info = with_processes.step(np.zeros((2, 5), np.float32))
        assert len(state_of(info)) == 2
    finally:
        with_processes.close()
    for index, seed in enumerate((4, 5)):
        alone = hand_environment(max_steps=50)
        _, single = alone.reset(seed=seed)
        np.testing.assert_array_equal(states.object_position[index], state_of(single).object_position[0])
        np.testing.assert_array_equal(observation["image"][index], alone.step(np.zeros(5))[0]["image"])


def test_settings_are_checked():
    bad = [
        {"task": "stack"},
        {"image_size": 100},
        {"image_size": True},
        {"renderer": "tiny"},
        {"max_steps": 0},
        {"max_steps": 2.5},
        {"position_step": 0.03},
        {"position_step": float("nan")},
        {"yaw_step": 0},
        {"aperture_step": -1},
        {"max_contact_force": 0},
        {"start_side": -0.1},
        {"start_yaw": (1.0, 0.0)},
        {"task": "pick_and_place"},
        {"plate": (0.0, 0.2)},
    ]
    for values in bad:
        with pytest.raises(InputError):
            EnvironmentSettings(**values)
    assert EnvironmentSettings().time_out == 80
    assert EnvironmentSettings(task="pick_and_place", plate=PLATE, max_contact_force=2.0).rules().max_contact_force == 2.0


def test_world_without_a_camera_needs_a_renderer_of_the_right_size():
    class Blind(HandWorld):
        image = property()

    class Blank:
        camera = wrist_camera(128)

    with pytest.raises(InputError, match="camera of its own"):
        PickEnvironment(Blind(), EnvironmentSettings(image_size=64))
    with pytest.raises(InputError, match="128 x 128"):
        PickEnvironment(HandWorld(), EnvironmentSettings(image_size=64), Blank())


@pytest.mark.parametrize(
    "region", [{"start_centre": (0.5, 0.265)}, {"start_centre": (0.03, 0.265)}, {"start_side": 0.36}, {"start_side": 3.0}]
)
def test_start_region_must_lie_where_the_tool_may_go(region):
    with pytest.raises(InputError, match=r"start region: .* beyond the workspace"):
        PickEnvironment(HandWorld(), EnvironmentSettings(image_size=64, **region))


def test_a_bad_action_in_a_vector_environment_is_told_as_in_a_single_one():
    vector = gymnasium.vector.AsyncVectorEnv([hand_environment] * 2)
    try:
        vector.reset(seed=0)
        with pytest.raises(InputError, match="action: it is not finite") as told:
            vector.step(np.full((2, 5), np.nan, np.float32))
        assert told.value.remedy == "Check the policy's output for NaN"
    finally:
        vector.close(terminate=True)
