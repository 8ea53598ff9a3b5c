"""Training: resuming bit by bit, the curve, evaluation poses, export without pickles, and that it learns."""

import csv
import json
import time
from functools import partial

import gymnasium
import numpy as np
import pytest
import torch
from policy_fixture import CONTROLLER, blob_environment

from gsbridge.configuration.policy import PolicySettings
from gsbridge.errors import InputError
from gsbridge.policy.curve import COLUMNS
from gsbridge.policy.evaluation import evaluate_controller, evaluation_poses
from gsbridge.policy.export import load_policy
from gsbridge.policy.format import SPEC, WEIGHTS
from gsbridge.policy.trainer import CURVE, Trainer
from gsbridge.tasks.poses import pose_set


def settings(**values) -> PolicySettings:
    few = {"steps": 36, "start_steps": 6, "eval_every": 10, "eval_poses": 4, "actor_batch": 4, "critic_batch": 8}
    return PolicySettings(**{**few, "replay_capacity": 200, "updates_per_step": 0.3, "lambda_share": 1.0, **values})


class Killed(gymnasium.Wrapper):
    """An environment that dies at a step."""

    def __init__(self, env, at):
        super().__init__(env)
        self.left = at

    def step(self, action):
        self.left -= 1
        if self.left < 0:
            raise KeyboardInterrupt
        return self.env.step(action)


class Noisy(gymnasium.ObservationWrapper):
    """Pictures with noise that an episode's seed decides, as all that is random in an environment."""

    def reset(self, *, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        return super().reset(seed=seed, options=options)

    def observation(self, observation):
        noise = self.rng.normal(0.0, 3.0, observation["image"].shape)
        return {**observation, "image": np.clip(observation["image"] + noise, 0, 255).astype(np.uint8)}


def environment():
    return Noisy(blob_environment(max_steps=12))


def curve(folder):
    with open(folder / CURVE, newline="") as file:
        rows = list(csv.DictReader(file))
    return [{name: value for name, value in row.items() if not name.startswith("cpu_")} for row in rows]


@pytest.mark.parametrize("algo", ["sacwb", "sac", "bc", "dagger"])
def test_killed_and_resumed_is_the_same_bit_for_bit(tmp_path, algo):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    chosen = settings(algo=algo, bf16=False)
    first = Trainer(environment(), CONTROLLER, chosen, seed=3).run(whole)
    deaths = 0
    # Killed in the second episode, killed while the second policy is evaluated, and not killed.
    for at in (115, 40, 10_000):
        try:
            second = Trainer(Killed(environment(), at), CONTROLLER, chosen, seed=3, state=parts / "state").run(parts)
        except KeyboardInterrupt:
            deaths += 1
            assert not (parts / WEIGHTS).exists()
    assert deaths == 2
    assert curve(whole) == curve(parts)
    assert len(curve(whole)) == 3
    assert (whole / WEIGHTS).read_bytes() == (parts / WEIGHTS).read_bytes()
    assert (first.best, first.retest) == (second.best, second.retest)
    assert len(list((parts / "state").iterdir())) == 1


def test_another_training_leaves_the_checkpoint_aside(tmp_path, caplog):
    chosen = settings(algo="bc", steps=12)
    Trainer(environment(), CONTROLLER, chosen, seed=3, state=tmp_path / "state", key={"code": "a"}).run(tmp_path)
    for seed, key in ((4, "a"), (3, "b")):
        trainer = Trainer(environment(), CONTROLLER, chosen, seed=seed, state=tmp_path / "state", key={"code": key})
        assert not trainer._resume()
        assert "another training" in caplog.text
        caplog.clear()
    assert Trainer(environment(), CONTROLLER, chosen, seed=3, state=tmp_path / "state", key={"code": "a"})._resume()


def test_damaged_checkpoint_is_named(tmp_path):
    chosen = settings(algo="bc", steps=12)
    Trainer(environment(), CONTROLLER, chosen, seed=3, state=tmp_path / "state").run(tmp_path)
    (learner,) = (tmp_path / "state").glob("*/learner.pt")
    learner.write_bytes(learner.read_bytes()[:-500])
    with pytest.raises(InputError, match="damaged"):
        Trainer(environment(), CONTROLLER, chosen, seed=3, state=tmp_path / "state")._resume()


def test_files_of_a_training(tmp_path):
    result = Trainer(environment(), CONTROLLER, settings(), seed=0).run(tmp_path)
    with open(tmp_path / CURVE, newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    last = {name: float(value) for name, value in rows[-1].items() if value}
    assert last["step"] == 36
    assert last["update"] == pytest.approx(0.3 * (last["step"] - 5), abs=1.5)
    assert last["success"] == np.mean([last[f"success_q{k}"] for k in (1, 2, 3, 4)])
    assert 0 <= last["actor_share"] <= 1
    assert 0 <= last["lambda"] < 0.1
    assert last["q_start"] == result.rows[-1]["q_start"]
    spec = json.loads((tmp_path / SPEC).read_text())
    assert spec["observation"]["image"]["size_px"] == 64
    assert spec["action"]["position_m"] == 0.024
    assert spec["training"]["algo"] == "sacwb"
    assert spec["figures"]["controller_success"] == result.controller


def test_loaded_policy_acts_bit_for_bit_alike(tmp_path):
    result = Trainer(environment(), CONTROLLER, settings(algo="bc", steps=24), seed=0).run(tmp_path)
    policy = load_policy(tmp_path)
    env = blob_environment()
    observation, info = env.reset(seed=5)
    for _ in range(20):
        action = policy(observation, info)
        np.testing.assert_array_equal(action, result.policy(observation))
        assert action.shape == (5,)
        assert action.dtype == np.float32
        observation, *_, info = env.step(action)
    assert policy.spec["task"] == "grasp"


def test_export_refuses_what_does_not_belong_together(tmp_path):
    Trainer(environment(), CONTROLLER, settings(algo="bc", steps=12), seed=0).run(tmp_path)
    spec, weights = (tmp_path / SPEC).read_text(), (tmp_path / WEIGHTS).read_bytes()
    (tmp_path / SPEC).write_text(spec.replace('"format": 1', '"format": 9'))
    with pytest.raises(InputError, match="format"):
        load_policy(tmp_path)
    (tmp_path / SPEC).write_text(spec)
    (tmp_path / WEIGHTS).write_bytes(weights[:-1] + b"x")
    with pytest.raises(InputError, match="does not belong"):
        load_policy(tmp_path)
    (tmp_path / WEIGHTS).unlink()
    with pytest.raises(InputError, match="cannot be read"):
        load_policy(tmp_path)


def test_evaluation_poses_are_a_third_set():
    env = blob_environment()
    poses = evaluation_poses(env.region, 32, 0)
    np.testing.assert_array_equal(poses, evaluation_poses(env.region, 32, 0))
    np.testing.assert_array_equal(env.region.quadrant(poses[:, :2]), np.repeat([1, 2, 3, 4], 8))
    others = [pose_set(name, env.region) for name in ("fixed", "unseen")]
    for other in (*others, evaluation_poses(env.region, 32, 0, draw=1), evaluation_poses(env.region, 32, 1)):
        assert np.abs(poses[:, None] - other[None]).max(-1).min() > 1e-4


def test_controller_is_tried_blind_and_pictures_come_back():
    env = blob_environment()
    eye = env.eye
    outcome = evaluate_controller(env, CONTROLLER, evaluation_poses(env.region, 8, 0), 0)
    assert outcome.rate == 1.0
    assert env.eye is eye
    assert np.isnan(outcome.expected).all()


def test_what_does_not_fit_is_refused():
    with pytest.raises(InputError, match="image_size"):
        Trainer(blob_environment(), CONTROLLER, settings(image_size=128), seed=0)
    with pytest.raises(InputError, match="needs a baseline controller"):
        Trainer(blob_environment(), None, settings(), seed=0)
    with pytest.raises(InputError, match="PickEnvironment"):
        Trainer(gymnasium.make("CartPole-v1"), CONTROLLER, settings(), seed=0)


def test_one_thread(tmp_path):
    torch.set_num_threads(2)
    Trainer(blob_environment(), CONTROLLER, settings(), seed=0)
    assert torch.get_num_threads() == 1


def together(algo="sacwb", **values):
    """Settings of a training in three environments, and their makers."""
    return settings(algo=algo, environments=3, **values), [environment] * 3


@pytest.mark.parametrize("algo", ["sacwb", "sac", "dagger"])
def test_several_environments_are_resumed_bit_for_bit_too(tmp_path, algo):
    chosen, makers = together(algo)
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    trainer = Trainer(environment(), CONTROLLER, chosen, seed=3, makers=makers)
    trainer.run(whole)
    trainer.close()
    # While the second policy is evaluated, never.
    for at in (100, 10_000):
        trainer = Trainer(Killed(environment(), at), CONTROLLER, chosen, seed=3, state=parts / "state", makers=makers)
        try:
            trainer.run(parts)
        except KeyboardInterrupt:
            killed = len(curve(parts))
        finally:
            trainer.close()
    assert 0 < killed < len(curve(parts))
    assert curve(whole) == curve(parts)
    assert (whole / WEIGHTS).read_bytes() == (parts / WEIGHTS).read_bytes()


def test_several_environments_play_the_episodes_of_one(tmp_path):
    """With the controller alone, without noise, each episode is the same, whoever plays it; cut ones keep their steps."""
    quiet = {"algo": "bc", "base_noise": 0.0, "steps": 60, "eval_every": 60, "start_steps": 1000}
    alone = Trainer(blob_environment(max_steps=12), CONTROLLER, settings(**quiet), seed=3)
    alone.run(tmp_path / "alone")
    chosen, _ = together(**quiet)
    crew = Trainer(blob_environment(), CONTROLLER, chosen, seed=3, makers=[partial(blob_environment, max_steps=12)] * 3)
    crew.run(tmp_path / "crew")
    crew.close()
    one, other = (stored_episodes(trainer.replay) for trainer in (alone, crew))
    assert len(crew.replay) == crew.at.step == 60
    shared = set(one) & set(other)
    assert len(shared) >= 3
    for start in shared:
        steps = min(len(one[start]), len(other[start]))
        assert steps >= 1
        np.testing.assert_array_equal(one[start][:steps], other[start][:steps])


class Burner(gymnasium.Wrapper):
    """An environment whose steps take processor time."""

    def step(self, action):
        begin = time.process_time()
        while time.process_time() - begin < 0.02:
            pass
        return self.env.step(action)


def test_processor_time_of_all_environments_counts(tmp_path):
    chosen, _ = together(algo="bc", steps=30, eval_every=30, start_steps=1000)
    makers = [lambda: Burner(blob_environment(max_steps=12))] * 3
    crew = Trainer(blob_environment(), CONTROLLER, chosen, seed=3, makers=makers)
    crew.run(tmp_path)
    crew.close()
    assert crew.clock.seconds["environment"] > 30 * 0.02


def stored_episodes(replay):
    """Privileged vectors of each stored episode, by the first one's bytes."""
    arrays, out, begun = replay._arrays, {}, None
    for slot in range(replay._filled):
        begun = slot if begun is None else begun
        if not arrays["starts"][slot]:
            rows = arrays["privileged"][begun : slot + 1]
            out[rows[0].tobytes()] = rows.copy()
            begun = None
    return out


def test_a_gpu_that_is_not_there_is_named():
    if torch.cuda.is_available():
        pytest.skip("there is one")
    with pytest.raises(InputError, match="CUDA"):
        Trainer(environment(), CONTROLLER, settings(device="cuda"), seed=0)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA GPU")
def test_learning_on_a_gpu_is_resumed_bit_for_bit(tmp_path):
    chosen = settings(device="cuda", algo="bc")
    Trainer(environment(), CONTROLLER, chosen, seed=3).run(tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        Trainer(Killed(environment(), 115), CONTROLLER, chosen, seed=3, state=tmp_path / "state").run(tmp_path / "parts")
    Trainer(environment(), CONTROLLER, chosen, seed=3, state=tmp_path / "state").run(tmp_path / "parts")
    assert curve(tmp_path / "whole") == curve(tmp_path / "parts")
