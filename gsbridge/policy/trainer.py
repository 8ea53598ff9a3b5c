"""Training of one policy in one environment, and its files: the policy, the learning curve, checkpoints to resume from.

An interrupted training resumes from its last checkpoint and gives the same curve and weights, bit for bit, as one that was
never interrupted; only the times in the curve differ.
"""

from __future__ import annotations

import copy
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch

from gsbridge.configuration.policy import PolicySettings
from gsbridge.environment.env import PickEnvironment
from gsbridge.errors import InputError
from gsbridge.logs import ProgressLog
from gsbridge.policy.agent import Agent
from gsbridge.policy.checkpoints import Checkpoint, load_checkpoint, save_checkpoint
from gsbridge.policy.curve import LEARNED, Meter, Row, TrainingClock, evaluation_row, write_curve
from gsbridge.policy.evaluation import bare, episode_seed, evaluate, evaluate_controller, evaluation_poses
from gsbridge.policy.export import Policy, describe, save_policy
from gsbridge.policy.observation import Controller, ObservedFrame, Observer, TrainingState
from gsbridge.policy.replay import Replay
from gsbridge.policy.rollouts import Rollouts

logger = logging.getLogger("gsbridge")

CURVE = "training.csv"
_METERED = ("training_success", "actor_share", *LEARNED)


@dataclass(frozen=True)
class Training:
    """Outcome of a training.

    Args:
        rows: The learning curve; see `gsbridge.policy.curve`.
        best: Success rate of the best weights in the evaluation by which they were chosen.
        retest: Success rate of the best weights on other poses; `best` is biased upwards, since it is a maximum.
        controller: Success rate of the controller; NaN without one.
        policy: The best weights.
        replay_bytes: Memory of the replay buffer.
        frames_per_second: Environment steps, each with its picture, per second of acting and learning.
    """

    rows: list[Row]
    best: float
    retest: float
    controller: float
    policy: Policy
    replay_bytes: int
    frames_per_second: float


@dataclass
class _Counters:
    """Progress of a training: all of its state that is not in the agent or the buffer."""

    step: int = 0
    episode: int = 0
    owed: float = 0.0
    next_eval: int = 0
    perfect: int = 0
    best: float = -1.0
    best_step: int = 0
    controller: float = float("nan")
    rows: list[Row] = field(default_factory=list)


@dataclass
class _Episode:
    """An episode that is being played in parallel to others.

    Args:
        first: Its first state.
        state: Its present state.
        past: Its steps so far, as `Replay.add` takes them.
    """

    first: TrainingState
    state: TrainingState
    past: list[tuple[np.ndarray, float, bool, TrainingState]] = field(default_factory=list)


class Trainer:
    """Runs one training; see the module.

    Args:
        environment: A `PickEnvironment`, wrapped or not.
        controller: The baseline controller; None only for `sac`.
        settings: Settings of the training.
        seed: Seed of everything that is random.
        state: Folder of checkpoints; None for no checkpoints.
        key: What else the training depends on (digests of files and code); a checkpoint with another key is ignored.
        makers: Functions that make the environments of the training, if the settings ask for several; `environment` then only
            serves evaluations.

    Raises:
        InputError: The environment's pictures have another size, or a controller or CUDA GPU is needed and missing.
    """

    def __init__(
        self,
        environment: gymnasium.Env,
        controller: Controller | None,
        settings: PolicySettings,
        *,
        seed: int,
        state: str | Path | None = None,
        key: Mapping[str, Any] | None = None,
        makers: Sequence[Callable[[], gymnasium.Env]] = (),
    ) -> None:
        inside = bare(environment)
        _check(inside, controller, settings)
        several = settings.environments > 1
        if several and len(makers) != settings.environments:
            raise ValueError(f"{len(makers)} makers for {settings.environments} environments")
        # Before anything is on a GPU, since the environments' processes are forks of this one.
        self.rollouts = Rollouts(makers) if several else None
        # One thread: small networks gain little from more, and sums in another order would change the curve.
        torch.set_num_threads(1)
        # For the same reason: a GPU's fastest convolutions differ from run to run, and round to ten bits.
        torch.backends.cudnn.deterministic, torch.backends.cudnn.benchmark, torch.backends.cudnn.allow_tf32 = True, False, False
        self.environment, self.controller, self.settings, self.seed = environment, controller, settings, seed
        self.state = None if state is None else Path(state)
        self.key = {"settings": settings.model_dump(), "environment": asdict(inside.settings), "seed": seed, **(key or {})}
        self.agent = Agent(settings, seed, settings.device)
        self.observer = Observer(ObservedFrame.of(inside), controller if settings.has_controller else None)
        self.replay = Replay(settings.replay_capacity, settings.image_size)
        self.rng = np.random.default_rng([seed, 4])
        self.at = _Counters(next_eval=settings.eval_every)
        self.clock, self.meter = self._clock(), Meter()
        self.poses = evaluation_poses(inside.region, settings.eval_poses, seed)
        self.best = copy.deepcopy(self.agent.averaged.state_dict())

    def run(self, out: str | Path) -> Training:
        """Train to the end and write the policy.

        Args:
            out: Folder of `policy.safetensors`, `policy.json` and `training.csv`.
        """
        out, settings = Path(out), self.settings
        if not self._resume() and self.controller is not None:
            self.at.controller = evaluate_controller(self.environment, self.controller, self.poses, self.seed).rate
        progress = ProgressLog(settings.steps, f"train {settings.algo}")
        progress.update(count=min(self.at.step, settings.steps))
        while not self._done():
            before = self.at.step
            if self.rollouts is None:
                self._episode()
            else:
                self._episodes(self.rollouts)
            last = self.at.step >= settings.steps
            if self.at.step >= self.at.next_eval or last:
                self._evaluate(out)
            rate = f"success {self.at.rows[-1]['success']:.0%}" if self.at.rows else ""
            progress.update(rate, count=min(self.at.step, settings.steps) - min(before, settings.steps))
        return self._finish(out)

    def close(self) -> None:
        """End the processes of the environments, if there are several."""
        if self.rollouts is not None:
            self.rollouts.close()

    def _done(self) -> bool:
        enough = 0 < self.settings.stop_after <= self.at.perfect
        return enough or self.at.step >= self.settings.steps

    def _episode(self) -> None:
        """Play one episode, and learn after each step."""
        at, clock, settings = self.at, self.clock, self.settings
        seed = episode_seed(self.seed, 0, at.episode)
        with clock.on("environment"):
            observation, info = self.environment.reset(seed=seed)
            state = self.observer(observation, info)
        self.replay.begin(state)
        ended = False
        while not ended:
            share = settings.lambda_at(at.step)
            with clock.on("act"):
                action, by_actor = self._act(state, share)
            with clock.on("environment"):
                observation, reward, terminated, truncated, info = self.environment.step(action)
                state = self.observer(observation, info)
            ended = terminated or truncated
            self.replay.add(action, float(reward), terminated, state, ended=ended)
            at.step += 1
            self.meter.see({"actor_share": float(by_actor)})
            with clock.on("update"):
                self._learn(share)
        at.episode += 1
        self.meter.see({"training_success": float(info["success"])})

    def _episodes(self, rollouts: Rollouts) -> None:
        """Play in all environments in parallel, and learn after each step, until an evaluation is due.

        An episode enters the replay buffer as a whole. Episodes that still run at the end are truncated, which leaves their
        value targets correct; a checkpoint then need not hold any running episode.
        """
        at, clock, settings = self.at, self.clock, self.settings
        with clock.on("environment"):
            running = self._begin(rollouts, range(len(rollouts)))
        while at.step < min(at.next_eval, settings.steps):
            share = settings.lambda_at(at.step)
            with clock.on("act"):
                chosen = self._act_all([running[k].state for k in range(len(rollouts))], share)
            over: list[int] = []
            with clock.on("environment"):
                taken = rollouts.step(np.stack([action for action, _ in chosen]))
                for k, ((seen, reward, terminated, truncated), (action, by_actor)) in enumerate(
                    zip(taken, chosen, strict=True)
                ):
                    episode = running[k]
                    episode.state = self.observer(*seen)
                    episode.past.append((action, reward, terminated, episode.state))
                    self.meter.see({"actor_share": float(by_actor)})
                    if terminated or truncated:
                        over.append(k)
                        self._keep(episode)
                        self.meter.see({"training_success": float(seen[1]["success"])})
                if over:
                    running |= self._begin(rollouts, over)
            with clock.on("update"):
                for _ in chosen:
                    at.step += 1
                    self._learn(share)
        for episode in running.values():
            self._keep(episode)

    def _clock(self, seconds: Mapping[str, float] | None = None, wall: float = 0.0) -> TrainingClock:
        """Make a clock that also counts the environments' processes, if there are any."""
        return (
            TrainingClock(seconds, wall) if self.rollouts is None else TrainingClock(seconds, wall, self.rollouts.cpu_seconds)
        )

    def _begin(self, rollouts: Rollouts, numbers: Iterable[int]) -> dict[int, _Episode]:
        """Begin the next episodes in some of the environments."""
        seeds = {}
        for number in numbers:
            seeds[number] = episode_seed(self.seed, 0, self.at.episode)
            self.at.episode += 1
        states = {number: self.observer(*seen) for number, seen in rollouts.begin(seeds).items()}
        return {number: _Episode(state, state) for number, state in states.items()}

    def _keep(self, episode: _Episode) -> None:
        """Put an episode into the replay buffer."""
        if not episode.past:
            return
        self.replay.begin(episode.first)
        for number, (action, reward, terminated, state) in enumerate(episode.past, 1):
            self.replay.add(action, reward, terminated, state, ended=number == len(episode.past))

    def _act(self, state: TrainingState, share: float) -> tuple[np.ndarray, bool]:
        """Choose an action in training, see `_act_all`."""
        return self._act_all([state], share)[0]

    def _act_all(self, states: Sequence[TrainingState], share: float) -> list[tuple[np.ndarray, bool]]:
        """Choose actions in training and tell whether they are the actor's; in `sac`, the first are random."""
        if self.settings.algo == "sac" and self.at.step < self.settings.start_steps:
            return [(self.rng.uniform(-1.0, 1.0, len(state.base)).astype(np.float32), False) for state in states]
        choices = self.agent.act_all(states, 1.0 if self.at.step < self.settings.start_steps else share)
        return [(choice.action, choice.by_actor) for choice in choices]

    def _learn(self, share: float) -> None:
        """Take the gradient steps that are due after one more environment step."""
        settings = self.settings
        if self.at.step < settings.start_steps or not len(self.replay):
            return
        self.at.owed += settings.updates_per_step
        while self.at.owed >= 1.0:
            size = settings.critic_batch if settings.has_critics else settings.actor_batch
            self.meter.see(self.agent.update(self.replay.sample(size, self.rng), share))
            self.at.owed -= 1.0

    def _evaluate(self, out: Path) -> None:
        """Evaluate, add a row to the curve, keep the best weights, and make a checkpoint."""
        at, settings = self.at, self.settings
        with self.clock.on("evaluate"):
            value = (
                (lambda observation, info: self.agent.value(self.observer(observation, info))) if settings.has_critics else None
            )
            policy = Policy(self.agent.averaged, settings.image_size)
            evaluation = evaluate(self.environment, policy, self.poses, self.seed, settings.gamma, value)
        at.rows.append(
            {
                "step": at.step,
                "episode": at.episode,
                "update": self.agent.updates,
                **evaluation_row(evaluation),
                "controller_success": None if np.isnan(at.controller) else at.controller,
                "lambda": settings.lambda_at(at.step),
                "alpha": self.agent.alpha if settings.has_critics else None,
                **self.meter.take(*_METERED),
                **{f"cpu_{part}_s": round(seconds, 3) for part, seconds in self.clock.seconds.items()},
            }
        )
        write_curve(out / CURVE, at.rows)
        # Of equally good weights, keep the later ones, which have learned longer.
        if evaluation.rate >= at.best:
            at.best, at.best_step = evaluation.rate, at.step
            self.best = copy.deepcopy(self.agent.averaged.state_dict())
        at.perfect = at.perfect + 1 if evaluation.success.all() else 0
        at.next_eval = at.step + settings.eval_every
        if self.state is not None:
            self._save()

    def _finish(self, out: Path) -> Training:
        """Test the best weights on other poses and write them."""
        inside, settings = bare(self.environment), self.settings
        self.agent.averaged.load_state_dict(self.best)
        policy = Policy(self.agent.averaged, settings.image_size, describe(inside, settings))
        others = evaluation_poses(inside.region, settings.eval_poses, self.seed, draw=1)
        retest = evaluate(self.environment, policy, others, self.seed, settings.gamma).rate
        figures = {
            "seed": self.seed,
            "best_step": self.at.best_step,
            "best_success": self.at.best,
            "retest_success": retest,
            "controller_success": self.at.controller,
            "steps": self.at.step,
            "updates": self.agent.updates,
            "target_alarms": self.agent.alarm.count,
        }
        save_policy(out, self.best, {**policy.spec, "figures": figures})
        write_curve(out / CURVE, self.at.rows)
        logger.info("best success %.0f %%, on other poses %.0f %%", 100 * self.at.best, 100 * retest)
        rate = self.at.step / max(self.clock.wall, 1e-9)
        logger.info("%.0f frames per second of acting and learning", rate)
        return Training(self.at.rows, self.at.best, retest, self.at.controller, policy, self.replay.nbytes, rate)

    def _save(self) -> None:
        """Make a checkpoint; this is between two episodes and right after an evaluation, so that the meter is empty."""
        assert self.state is not None
        run = {**asdict(self.at), "seconds": self.clock.seconds, "wall": self.clock.wall, "rng": self.rng.bit_generator.state}
        learner = {"agent": self.agent.state(), "best": self.best}
        save_checkpoint(self.state, self.key, Checkpoint(run, learner, self.replay))

    def _resume(self) -> bool:
        """Resume from a checkpoint; return whether there was one."""
        checkpoint = None if self.state is None else load_checkpoint(self.state, self.key)
        if checkpoint is None:
            return False
        run = dict(checkpoint.run)
        try:
            self.clock = self._clock(run.pop("seconds"), run.pop("wall"))
            self.rng.bit_generator.state = run.pop("rng")
            # JSON has no NaN.
            self.at = _Counters(**{**run, "controller": np.nan if run["controller"] is None else run["controller"]})
            self.best = checkpoint.learner["best"]
            self.agent.restore(checkpoint.learner["agent"])
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(self.state or "", f"the checkpoint is damaged ({error})", "Delete it and train anew") from error
        self.replay = checkpoint.replay
        logger.info("going on from step %d", self.at.step)
        return True


def _check(environment: PickEnvironment, controller: Controller | None, settings: PolicySettings) -> None:
    """Check that environment, controller and settings fit together."""
    if environment.settings.image_size != settings.image_size:
        raise InputError(
            "policy: image_size",
            f"the environment's pictures have {environment.settings.image_size} px, the policy asks for {settings.image_size}",
            "Give both the same",
        )
    if settings.device == "cuda" and not torch.cuda.is_available():
        raise InputError("policy: device", "there is no CUDA GPU here, or this PyTorch was built without CUDA", "Give cpu")
    if settings.has_controller and controller is None:
        raise InputError("policy", f"{settings.algo} needs a baseline controller", "Give one, or use sac")
