"""An episode is kept as it was played, comes back whole from its file, and damaged files are refused."""

from dataclasses import fields, replace

import numpy as np
import pytest
from environment_fixture import GRIP, hand_environment

from gsbridge.environment.controllers import GraspController
from gsbridge.environment.env import OwnEye
from gsbridge.environment.episode import play
from gsbridge.errors import InputError
from gsbridge.tasks.episode import FORCES, Episode, read_episode, write_episode
from gsbridge.tasks.views import read_states, write_states

PERIOD = 0.05


def played(**settings) -> Episode:
    eyes = {"gs": OwnEye(64), "mesh": OwnEye(64)}
    return play(hand_environment(**settings), GraspController(GRIP), eyes, period=PERIOD, index=3)


@pytest.fixture(scope="module")
def episode() -> Episode:
    return played()


def test_it_holds_what_happened(episode):
    steps = len(episode) - 1
    assert episode.success[-1]
    assert not episode.success[:-1].any()
    assert (episode.task, episode.failure[-1]) == ("grasp", "none")
    np.testing.assert_array_equal(episode.rewards, [*np.zeros(steps - 1), 1.0])
    np.testing.assert_allclose(episode.time[[0, 1, -1]], [0.0, PERIOD, steps * PERIOD])
    # The fixture's cube hangs on both pads and touches nothing when it is up.
    np.testing.assert_allclose(episode.forces[-1], [40.0, 40.0, 0.0, 0.0])
    np.testing.assert_allclose(episode.forces[0, FORCES.index("object_on_table")], 1.1)
    np.testing.assert_allclose(episode.body("object")[:, 2, 3], episode.clearance)
    np.testing.assert_allclose(episode.clearance, episode.terms["clearance"])
    assert episode.clearance[-1] > 0.1
    assert episode.proprio.shape == (steps + 1, 12)
    # Pictures of the same moments: they change when the hand moves.
    assert episode.images["gs"].shape == (steps + 1, 64, 64, 3)
    assert (episode.images["mesh"][0] != episode.images["mesh"][5]).any()


def test_actions_lead_from_state_to_state(episode):
    """Played again from the same start, the actions give the same states."""
    environment = hand_environment()
    environment.reset(seed=3, options={"pose_set": "fixed", "index": 3})
    for step, action in enumerate(episode.actions):
        observation = environment.step(action)[0]
        np.testing.assert_array_equal(observation["proprio"], episode.proprio[step + 1])


def test_an_episode_that_runs_out_of_time_tells_why():
    episode = played(max_steps=5)
    assert len(episode) == 6
    assert not episode.success.any()
    assert episode.failure[-1] == "not_grasped"


def test_it_comes_back_as_it_was_written(episode, tmp_path):
    write_episode(tmp_path / "episode.npz", episode)
    found = read_episode(tmp_path / "episode.npz")
    for item in fields(Episode):
        one, two = getattr(episode, item.name), getattr(found, item.name)
        if isinstance(one, dict):
            assert list(one) == list(two)
            for key in one:
                np.testing.assert_array_equal(one[key], two[key])
        else:
            np.testing.assert_array_equal(one, two)
    write_episode(tmp_path / "again.npz", played())
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "episode.npz").read_bytes()


def test_states_for_other_worlds_keep_the_whole_pose(episode, tmp_path):
    write_states(tmp_path / "states.json", episode.states(), "fixed")
    found = read_states(tmp_path / "states.json")
    assert [state.step for state in found] == list(range(len(episode)))
    np.testing.assert_array_equal(np.stack([state.object_pose for state in found]), episode.body("object"))
    np.testing.assert_array_equal([state.aperture for state in found], episode.aperture)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.97])
def test_a_cut_file_is_refused(episode, tmp_path, share):
    path = tmp_path / "episode.npz"
    write_episode(path, episode)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match="the episode is damaged"):
        read_episode(path)


def test_a_changed_byte_is_noticed(episode, tmp_path):
    path = tmp_path / "episode.npz"
    write_episode(path, episode)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(InputError, match="the episode is damaged"):
        read_episode(path)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("poses", None, "poses"),
        ("actions", np.zeros((3, 5)), "actions has the shape"),
        ("image_gs", np.zeros((4, 8, 8, 3), np.uint8), "image_gs has the shape"),
        ("names", np.array(["cup", "tool"]), "no object"),
        ("aperture", "nan", "aperture is not finite"),
    ],
)
def test_contents_that_do_not_fit_are_refused(episode, tmp_path, key, value, said):
    path = tmp_path / "episode.npz"
    write_episode(path, episode)
    with np.load(path) as file:
        content = dict(file)
    if value is None:
        del content[key]
    else:
        content[key] = np.full_like(content[key], np.nan) if isinstance(value, str) else value
    np.savez(path, **content)
    with pytest.raises(InputError, match=said):
        read_episode(path)


def test_a_missing_file_and_a_body_that_is_not_there(episode, tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read_episode(tmp_path / "episode.npz")
    with pytest.raises(KeyError, match="no body 'cup'"):
        episode.body("cup")
    with pytest.raises(ValueError, match="no step"):
        replace(episode, names=("cup", "tool"))
