"""The agent: acting by lambda and by value, targets end to end, repeatable updates, state and back."""

import copy

import numpy as np
import pytest
import torch
from policy_fixture import blob_environment, blob_observer

from gsbridge.configuration.policy import PolicySettings
from gsbridge.errors import InputError
from gsbridge.policy.agent import Agent
from gsbridge.policy.observation import picture
from gsbridge.policy.replay import Replay

torch.set_num_threads(1)


def settings(**values) -> PolicySettings:
    return PolicySettings(**{"actor_batch": 8, "critic_batch": 16, "augment": True, "steps": 100, **values})


@pytest.fixture(scope="module")
def replay() -> Replay:
    """Two episodes of the controller with noise."""
    environment = blob_environment(max_steps=25)
    observer, out, rng = blob_observer(environment), Replay(200, 64), np.random.default_rng(0)
    for seed in range(2):
        sight = observer(*environment.reset(seed=seed))
        out.begin(sight)
        ended = False
        while not ended:
            action = np.clip(sight.base + 0.3 * rng.normal(size=5), -1, 1).astype(np.float32)
            observation, reward, terminated, truncated, info = environment.step(action)
            sight = observer(observation, info)
            ended = terminated or truncated
            out.add(action, reward, terminated, sight, ended=ended)
    return out


@pytest.fixture
def sight():
    environment = blob_environment()
    return blob_observer(environment)(*environment.reset(seed=3))


def test_lambda_one_follows_the_controller_and_zero_the_actor(sight):
    agent = Agent(settings(base_noise=0.0, algo="dagger"), 0)
    choice = agent.act_all([sight], 1.0)[0]
    assert not choice.by_actor
    np.testing.assert_array_equal(choice.action, sight.base)
    choices = [agent.act_all([sight], 0.3)[0] for _ in range(200)]
    assert 0.6 < np.mean([choice.by_actor for choice in choices]) < 0.8
    own = {choice.action.tobytes() for choice in choices if choice.by_actor}
    assert len(own) == 1  # the mean, without chance


def test_sacwb_takes_the_action_of_greater_value(sight):
    agent = Agent(settings(base_noise=0.0), 0)
    for sign in (1.0, -1.0):
        # Critics that value nothing but the first entry of the action.
        for critic in (agent.critics.first, agent.critics.second):
            with torch.no_grad():
                for parameter in critic.parameters():
                    parameter.zero_()
                for layer in (critic[0], critic[2], critic[4]):
                    layer.weight[0, 0] = 1.0
                critic[0].weight[0, 0] = 0.0
                critic[0].weight[0, -5] = sign
                critic[0].bias[0] = 2.0
        for _ in range(20):
            choice = agent.act_all([sight], 0.0)[0]
            own = choice.action[0]
            if choice.by_actor:
                assert sign * own >= sign * sight.base[0]
            else:
                assert choice.action[0] == sight.base[0]


def test_noise_goes_on_actions_of_the_controller(sight):
    agent = Agent(settings(base_noise=0.2), 0)
    actions = np.stack([agent.act_all([sight], 1.0)[0].action for _ in range(400)])
    inside = np.abs(sight.base) < 0.3
    assert actions[:, inside].std(0) == pytest.approx(0.2, rel=0.15)
    assert np.abs(actions).max() <= 1.0


@pytest.mark.parametrize("target", ["official", "paper", "none"])
def test_targets_are_the_formula_on_the_networks_own_numbers(replay, target):
    agent = Agent(settings(target=target, alpha_start=0.01), 1)
    batch = replay.sample(16, np.random.default_rng(1))
    twin = torch.Generator()
    twin.set_state(agent.generator.get_state())
    found, figures = agent.targets(batch)
    with torch.no_grad():
        pi, _ = agent.actor(picture(batch.next_image), batch.next_proprio)
        action, log_prob = pi.sample(twin)
        q_actor = agent.target_critics.least(batch.next_privileged, action)
        q_base = agent.target_critics.least(batch.next_privileged, batch.next_base)
        own, base = q_actor - 0.01 * log_prob, q_base - 0.01 * pi.log_prob(batch.next_base)
        value = {"official": torch.maximum(q_actor, q_base) - 0.01 * log_prob, "paper": torch.maximum(own, base), "none": own}
    torch.testing.assert_close(found, batch.reward + 0.97 * (1 - batch.terminated) * value[target])
    assert figures["target_max"] == pytest.approx(float(found.max()))


def test_an_update_moves_what_it_should(replay):
    agent = Agent(settings(alpha_start=0.01, alpha_cap=0.02), 2)
    before = copy.deepcopy(agent.state())
    batch = replay.sample(16, np.random.default_rng(2))
    figures = agent.update(batch, 1.0)
    after = agent.state()
    for part in ("actor", "critics"):
        assert all(not torch.equal(before[part][name], value) for name, value in after[part].items()), part
    for name, value in after["target_critics"].items():
        moved = torch.lerp(before["target_critics"][name], after["critics"][name], 0.01)
        torch.testing.assert_close(value, moved)
        assert value.data_ptr() != after["critics"][name].data_ptr()
    # With lambda 1 all is imitated, and an actor above its target entropy lowers the temperature.
    assert figures["imitated_share"] == 1.0
    assert figures["entropy"] > -5.0
    assert agent.alpha < 0.01
    assert agent.updates == 1


@pytest.mark.parametrize("algo", ["bc", "dagger"])
def test_imitation_alone_leaves_the_critics(replay, algo):
    agent = Agent(settings(algo=algo), 2)
    before = copy.deepcopy(agent.critics.state_dict())
    figures = agent.update(replay.sample(16, np.random.default_rng(2)), 0.5)
    assert all(torch.equal(before[name], value) for name, value in agent.critics.state_dict().items())
    assert "target_mean" not in figures
    assert figures["imitated_share"] == 1.0


def test_temperature_keeps_to_its_cap(replay):
    agent = Agent(settings(target_entropy=5.0, alpha_start=0.01, alpha_rate=0.1), 2)
    rng = np.random.default_rng(2)
    for _ in range(3):
        agent.update(replay.sample(16, rng), 0.5)
    assert agent.alpha == pytest.approx(0.01)


def test_plain_soft_actor_critic_sees_no_controller(replay):
    batch = replay.sample(16, np.random.default_rng(2))
    agents = [Agent(settings(algo="sac"), 2) for _ in range(2)]
    agents[0].update(batch, 0.0)
    agents[1].update(without_controller(batch), 0.0)
    for a, b in zip(agents[0].actor.parameters(), agents[1].actor.parameters(), strict=True):
        assert torch.equal(a, b)


def without_controller(batch):
    """The same batch with other actions of the controller."""
    return type(batch)(**{**vars(batch), "base": -batch.base, "next_base": -batch.next_base})


@pytest.mark.parametrize("bf16", [False, True])
def test_same_seed_same_learning_and_state_and_back(replay, bf16):
    agents = [Agent(settings(bf16=bf16), 5) for _ in range(2)]
    draws = [np.random.default_rng(5) for _ in range(2)]
    for agent, rng in zip(agents, draws, strict=True):
        agent.update(replay.sample(16, rng), 0.5)
    third = Agent(settings(bf16=bf16), 99)
    third.restore(copy.deepcopy(agents[0].state()))
    more = [agent.update(replay.sample(16, np.random.default_rng(6)), 0.5) for agent in (*agents, third)]
    assert more[0] == more[1] == more[2]
    for other in (agents[1], third):
        for name, value in agents[0].actor.state_dict().items():
            assert torch.equal(value, other.actor.state_dict()[name])
    assert more[0] != Agent(settings(bf16=bf16), 6).update(replay.sample(16, np.random.default_rng(6)), 0.5)


def test_learning_draws_nothing_from_the_global_generator(replay):
    torch.manual_seed(1)
    before = torch.get_rng_state()
    agent = Agent(settings(), 5)
    agent.update(replay.sample(16, np.random.default_rng(5)), 0.5)
    assert torch.equal(before, torch.get_rng_state())


def test_state_of_another_network_is_refused():
    state = Agent(settings(), 0).state()
    with pytest.raises(InputError, match="does not fit"):
        Agent(settings(), 0).restore({**state, "actor": state["critics"]})


def test_the_papers_target_rings_the_alarm_where_the_official_one_does_not(replay):
    """An actor that is sure of actions far from the controller's, with a large temperature."""
    for target, rung in (("paper", True), ("official", False)):
        agent = Agent(settings(target=target, alpha_start=0.05, alpha_cap=0.05), 3)
        with torch.no_grad():
            agent.actor.log_std.bias.fill_(-2.0)
            agent.actor.mean.bias.fill_(-3.0)
        _, figures = agent.targets(replay.sample(16, np.random.default_rng(3)))
        assert bool(figures["alarm"]) is rung, target


def test_the_average_is_the_mean_at_first_and_forgets_later(replay):
    agent, fixed, rng = Agent(settings(averaging=0.25), 0), [], np.random.default_rng(0)
    for _ in range(6):
        agent.update(replay.sample(16, rng), 1.0)
        fixed.append([parameter.detach().clone() for parameter in agent.actor.parameters()])
    expected = [torch.zeros_like(parameter) for parameter in fixed[0]]
    for number, weights in enumerate(fixed, start=1):
        share = max(0.25, 1.0 / number)
        expected = [(1 - share) * old + share * new for old, new in zip(expected, weights, strict=True)]
    for found, wanted in zip(agent.averaged.parameters(), expected, strict=True):
        torch.testing.assert_close(found, wanted)
