"""The replay buffer: each frame once, episodes kept apart, the ring's seam, exact files."""

import numpy as np
import pytest
import torch

from gsbridge.errors import InputError
from gsbridge.policy.observation import POSITION, PRIVILEGED, TrainingState
from gsbridge.policy.replay import Replay


def sight(number: int) -> TrainingState:
    """A state that can be recognised: every array holds its number."""
    return TrainingState(
        np.full((8, 8, 3), number, np.uint8),
        np.full(12, number, np.float32),
        np.full(PRIVILEGED, number, np.float32),
        np.full(POSITION, number, np.float32),
        np.full(5, number / 1000, np.float32),
    )


def fill(replay: Replay, lengths, *, first: int = 0, truncate=()) -> dict[int, tuple[int, bool]]:
    """Episodes of given lengths; returns for every state that starts a step the state it led to, and whether it terminated."""
    number, steps = first, {}
    for k, length in enumerate(lengths):
        replay.begin(sight(number))
        for step in range(length):
            last = step == length - 1
            terminated = last and k not in truncate
            replay.add(np.full(5, number / 500), float(terminated), terminated, sight(number + 1), ended=last)
            steps[number] = (number + 1, terminated)
            number += 1
        number += 1
    return steps


def drawn(replay: Replay, count: int = 2000):
    batch = replay.sample(count, np.random.default_rng(0))
    for name in ("image", "privileged", "position"):
        np.testing.assert_array_equal(getattr(batch, name).reshape(count, -1)[:, 0], batch.proprio[:, 0])
    for name in ("next_image", "next_privileged"):
        np.testing.assert_array_equal(getattr(batch, name).reshape(count, -1)[:, 0], batch.next_proprio[:, 0])
    np.testing.assert_allclose(batch.base[:, 0], batch.proprio[:, 0] / 1000)
    np.testing.assert_allclose(batch.next_base[:, 0], batch.next_proprio[:, 0] / 1000)
    np.testing.assert_allclose(batch.action[:, 0], batch.proprio[:, 0] / 500)
    np.testing.assert_array_equal(batch.reward, batch.terminated)
    numbers = zip(batch.proprio[:, 0].int().tolist(), batch.next_proprio[:, 0].int().tolist(), strict=True)
    return {here: (then, bool(end)) for (here, then), end in zip(numbers, batch.terminated.tolist(), strict=True)}


def test_steps_never_cross_episodes_and_truncation_does_not_terminate():
    replay = Replay(50, 8)
    expected = fill(replay, [3, 5, 1, 4], truncate=(1,))
    assert len(replay) == 13
    assert drawn(replay) == expected
    assert [expected[k][1] for k in (2, 8, 10)] == [True, False, True]


def test_an_unfinished_episode_can_be_learned_from():
    replay = Replay(50, 8)
    replay.begin(sight(0))
    with pytest.raises(ValueError, match="no transition"):
        replay.sample(1, np.random.default_rng(0))
    replay.add(np.zeros(5), 0.0, False, sight(1))
    assert drawn(replay) == {0: (1, False)}


def test_the_ring_forgets_the_oldest_and_keeps_no_torn_step():
    replay = Replay(11, 8)
    steps = fill(replay, [3, 4, 2, 5])  # 18 states
    found = drawn(replay)
    # The slots hold states 7 to 17.
    assert found == {here: to for here, to in steps.items() if here >= 7}
    rng = np.random.default_rng(1)
    for _ in range(20):
        steps = fill(replay, rng.integers(1, 6, 3))
        newest = max(to for to, _ in steps.values())
        for here, to in drawn(replay, 200).items():
            if here in steps and here > newest - 11:
                assert steps[here][0] == to[0]


def test_adding_needs_an_episode():
    replay = Replay(10, 8)
    with pytest.raises(ValueError, match="begun"):
        replay.add(np.zeros(5), 0.0, False, sight(0))
    fill(replay, [2])
    with pytest.raises(ValueError, match="begun"):
        replay.add(np.zeros(5), 0.0, False, sight(0))


def test_memory_is_one_frame_per_state():
    assert Replay(1000, 64).nbytes == pytest.approx(1000 * 64 * 64 * 3, rel=0.03)


@pytest.mark.parametrize("lengths", [[3, 4], [3, 4, 2, 5, 6]])
def test_file_and_back_exactly(tmp_path, lengths):
    replay = Replay(13, 8)
    fill(replay, lengths)
    replay.save(tmp_path / "replay.npz")
    again = Replay.load(tmp_path / "replay.npz")
    for other in (replay, again):
        fill(other, [4], first=100)
    first, second = (r.sample(64, np.random.default_rng(3)) for r in (replay, again))
    for name, value in vars(first).items():
        assert torch.equal(value, getattr(second, name)), name


def test_damaged_file(tmp_path):
    path = tmp_path / "replay.npz"
    Replay(13, 8).save(path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(InputError, match="damaged"):
        Replay.load(path)
    with pytest.raises(InputError, match="damaged"):
        Replay.load(tmp_path / "none.npz")
