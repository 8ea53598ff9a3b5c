"""It learns: from pictures of a hand and a cube, without physics, from a small start region."""

import pytest
from policy_fixture import CONTROLLER, blob_environment

from gsbridge.configuration.policy import PolicySettings
from gsbridge.policy.trainer import Trainer


def learn(folder, algo: str, steps: int):
    """Train until an evaluation is without failure; batches are half of the usual, to be quick."""
    settings = PolicySettings(
        algo=algo,
        steps=steps,
        start_steps=100,
        updates_per_step=0.5,
        actor_batch=64,
        critic_batch=64,
        base_noise=0.2,
        lambda_floor=0.0,
        augment=False,
        replay_capacity=3_000,
        eval_every=500,
        eval_poses=8,
        stop_after=1,
    )
    environment = blob_environment(start_side=0.1, start_yaw=(0.0, 0.0))
    return Trainer(environment, CONTROLLER, settings, seed=0).run(folder)


def test_dagger_learns_from_pictures(tmp_path):
    result = learn(tmp_path, "dagger", 1500)
    assert result.controller == 1.0
    assert result.best >= 0.8
    assert result.retest >= 0.7
    assert result.rows[-1]["position_loss"] < 0.2


@pytest.mark.slow
def test_sacwb_learns_from_pictures(tmp_path):
    result = learn(tmp_path, "sacwb", 1500)
    assert result.best >= 0.8
    assert result.retest >= 0.7
    # Returns lie between 0 and 1: critics that learn do not stray far from there.
    assert result.rows[-1]["target_max"] < 1.2
    assert -0.1 < result.rows[-1]["q_start"] < 1.0
