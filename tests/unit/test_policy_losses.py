"""Targets and losses against formulas written out in float64, and the divergence of the paper's target."""

import numpy as np
import pytest
import torch
from scipy.stats import norm

from gsbridge.policy import losses
from gsbridge.policy.networks import EDGE, TanhGaussian

ALPHA, GAMMA = 0.03, 0.97


@pytest.fixture
def numbers():
    rng = np.random.default_rng(1)
    out = {name: rng.normal(size=64) for name in ("q_actor", "q_base", "log_actor", "log_base")}
    out["reward"] = (rng.random(64) < 0.3).astype(float)
    out["terminated"] = (rng.random(64) < 0.3).astype(float)
    return out


def tensors(numbers, *names):
    return [torch.tensor(numbers[name], dtype=torch.float32) for name in names]


def test_targets_are_the_written_formulas(numbers):
    r, d, qa, qb, la, lb = (numbers[name] for name in ("reward", "terminated", "q_actor", "q_base", "log_actor", "log_base"))
    given = tensors(numbers, "reward", "terminated", "q_actor", "q_base", "log_actor")
    official = [r[i] + GAMMA * (1 - d[i]) * (max(qa[i], qb[i]) - ALPHA * la[i]) for i in range(64)]
    paper = [r[i] + GAMMA * (1 - d[i]) * max(qa[i] - ALPHA * la[i], qb[i] - ALPHA * lb[i]) for i in range(64)]
    plain = [r[i] + GAMMA * (1 - d[i]) * (qa[i] - ALPHA * la[i]) for i in range(64)]
    np.testing.assert_allclose(losses.official_target(*given, ALPHA, GAMMA), official, rtol=2e-6, atol=1e-6)
    log_base = tensors(numbers, "log_base")[0]
    np.testing.assert_allclose(losses.paper_target(*given, log_base, ALPHA, GAMMA), paper, rtol=2e-6, atol=1e-6)
    reward, terminated, q_actor, _, log_actor = given
    np.testing.assert_allclose(
        losses.plain_target(reward, terminated, q_actor, log_actor, ALPHA, GAMMA), plain, rtol=2e-6, atol=1e-6
    )
    # Without a controller worth more, the official target is soft actor-critic's.
    np.testing.assert_array_equal(
        losses.official_target(reward, terminated, q_actor, q_actor - 1, log_actor, ALPHA, GAMMA),
        losses.plain_target(reward, terminated, q_actor, log_actor, ALPHA, GAMMA),
    )


def test_terminated_transitions_see_no_future(numbers):
    given = tensors(numbers, "reward", "terminated", "q_actor", "q_base", "log_actor")
    given[1] = torch.ones(64)
    np.testing.assert_array_equal(losses.official_target(*given, ALPHA, GAMMA), given[0])


def test_the_papers_target_grows_with_the_actors_confidence_and_the_official_one_does_not():
    """A saturated controller action far from a confident actor: log pi(b') falls without bound."""
    base = torch.tensor([[1.0, 1.0, -1.0, 0.0, -1.0]])
    ones, zeros = torch.ones(1), torch.zeros(1)
    paper, official = [], []
    for log_std in (-1.0, -2.0, -3.0):
        pi = TanhGaussian(torch.zeros(1, 5), torch.full((1, 5), log_std))
        log_actor = pi.log_prob(pi.mode)
        given = (zeros, zeros, 0.5 * ones, 0.5 * ones, log_actor)
        paper.append(float(losses.paper_target(*given, pi.log_prob(base), 0.05, GAMMA)))
        official.append(float(losses.official_target(*given, 0.05, GAMMA)))
    assert paper[0] < paper[1] < paper[2]
    assert paper[2] > 10.0
    assert max(official) < 0.6


def test_critic_loss_and_its_gradient():
    rng = np.random.default_rng(2)
    first, second, target = rng.normal(size=(3, 16))
    a, b = (torch.tensor(x, requires_grad=True) for x in (first, second))
    loss = losses.critic_loss(a, b, torch.tensor(target))
    assert float(loss.detach()) == pytest.approx(np.mean((first - target) ** 2) + np.mean((second - target) ** 2))
    loss.backward()
    np.testing.assert_allclose(a.grad, 2 * (first - target) / 16)
    np.testing.assert_allclose(b.grad, 2 * (second - target) / 16)


def test_soft_loss():
    rng = np.random.default_rng(3)
    q, log_prob = rng.normal(size=(2, 16))
    assert float(losses.soft_loss(torch.tensor(q), torch.tensor(log_prob), 0.2)) == pytest.approx(np.mean(0.2 * log_prob - q))


def test_imitated_by_coin_or_by_value():
    q_base, q_actor = torch.tensor([0.5, 0.1, 0.5, 0.1, 0.3]), torch.tensor([0.1, 0.5, 0.1, 0.5, 0.3])
    coin = torch.tensor([0.1, 0.1, 0.9, 0.9, 0.9])
    assert losses.imitated(q_base, q_actor, coin, 0.5).tolist() == [1, 1, 1, 0, 0]
    assert losses.imitated(q_base, q_actor, coin, 1.0).tolist() == [1] * 5
    assert losses.imitated(q_base, q_actor, coin, 0.0).tolist() == [1, 0, 1, 0, 0]


def test_imitation_loss_counts_masked_rows_only_and_fades():
    rng = np.random.default_rng(4)
    mode, base = rng.uniform(-1, 1, (2, 6, 5))
    mask = np.array([1, 0, 1, 1, 0, 0])
    expected = sum(np.mean((mode[i] - base[i]) ** 2) for i in (0, 2, 3)) / 6
    tensor = torch.tensor(mode, requires_grad=True)
    loss = losses.imitation_loss(tensor, torch.tensor(base), torch.tensor(mask))
    assert float(loss.detach()) == pytest.approx(expected)
    loss.backward()
    np.testing.assert_allclose(tensor.grad, mask[:, None] * 2 * (mode - base) / 30, atol=1e-15)


def test_position_loss():
    guess, label = torch.tensor([[1.0, 2.0, 3.0]]), torch.tensor([[0.0, 2.0, 1.0]])
    assert float(losses.position_loss(guess, label)) == pytest.approx(5 / 3)


def test_temperature_rises_while_entropy_is_low():
    log_alpha = torch.tensor(-3.0, requires_grad=True)
    log_prob = torch.tensor([4.0, 8.0], requires_grad=True)  # entropy -6, below -5
    loss = losses.temperature_loss(log_alpha, log_prob, -5.0)
    assert float(loss.detach()) == pytest.approx(3.0)
    loss.backward()
    assert float(log_alpha.grad) == pytest.approx(-1.0)  # a step of Adam goes up
    assert log_prob.grad is None


def test_alarm_above_the_return_bound(caplog):
    alarm = losses.TargetAlarm(1.0, margin=0.1)
    assert not alarm.see(torch.tensor([0.0, 1.05, -3.0]))
    assert caplog.records == []
    assert alarm.see(torch.tensor([0.0, 1.2]))
    assert alarm.see(torch.tensor([float("nan")]))
    assert alarm.count == 2
    assert len(caplog.records) == 1


def test_log_prob_of_given_actions():
    """Change of variables, in float64: density of tanh^-1(a) over the slope of tanh."""
    rng = np.random.default_rng(5)
    mean, log_std, action = rng.normal(size=(32, 5)), rng.uniform(-3, 1, (32, 5)), rng.uniform(-0.99, 0.99, (32, 5))
    expected = (norm.logpdf(np.arctanh(action), mean, np.exp(log_std)) - np.log(1 - action**2)).sum(1)
    pi = TanhGaussian(torch.tensor(mean), torch.tensor(log_std))
    np.testing.assert_allclose(pi.log_prob(torch.tensor(action)), expected, rtol=1e-9)


def test_log_prob_is_a_density():
    grid = np.linspace(-1 + 1e-4, 1 - 1e-4, 20001)
    pi = TanhGaussian(torch.full((len(grid), 1), 0.4).double(), torch.full((len(grid), 1), -0.7).double())
    density = np.exp(pi.log_prob(torch.tensor(grid)[:, None]).numpy())
    assert np.trapezoid(density, grid) == pytest.approx(1.0, abs=2e-3)


def test_log_prob_at_the_edge_is_finite_and_has_a_gradient():
    mean = torch.zeros(1, 5, requires_grad=True)
    pi = TanhGaussian(mean, torch.full((1, 5), -3.0))
    edge = pi.log_prob(torch.ones(1, 5))
    torch.testing.assert_close(edge, pi.log_prob(torch.full((1, 5), 1.0 - EDGE)))
    assert torch.isfinite(edge).all()
    edge.sum().backward()
    assert torch.isfinite(mean.grad).all()


def test_sampled_actions_and_their_log_prob():
    pi = TanhGaussian(torch.full((4000, 5), 0.3).double(), torch.full((4000, 5), -1.0).double())
    action, log_prob = pi.sample(torch.Generator().manual_seed(0))
    inside = (action.abs() < 1 - EDGE).all(1)
    torch.testing.assert_close(log_prob[inside], pi.log_prob(action[inside]))
    before = torch.atanh(action)
    assert float(before.mean()) == pytest.approx(0.3, abs=0.01)
    assert float(before.std()) == pytest.approx(np.exp(-1.0), abs=0.01)
    again, _ = pi.sample(torch.Generator().manual_seed(0))
    assert torch.equal(action, again)
