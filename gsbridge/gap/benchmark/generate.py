"""Drawing of cases of mechanisms: what is hidden, how large it is, and the records that a diagnosis gets."""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.benchmark.noises import spoiled
from gsbridge.gap.benchmark.trajectories import KINDS, Course, course
from gsbridge.gap.formats.records import Record
from gsbridge.geometry import Array

Truth = Callable[[Course, float, Array, Mapping[str, float]], dict[str, Array]]
"""Simulator: course, duration (s), sample times (s, [T]) and hidden sizes -> channels, each [T, N]."""

_TRIES = 18

UNIT = 25.0
"""Squared length, in units of the noise, of an effect's noise-free signature on `select` at a size of one unit."""

_LONGEST = 400
"""Number of samples (4 s at 100 Hz) up to which the unit shrinks as a record gets longer; beyond, it stays the same."""

_SHARE = 0.5
"""Smallest joint signature of all hidden effects on `fit` and `select`, as a share of that of one effect. It excludes effects
that cancel, such as a delay and a clock offset, and effects that do not show on `fit`, such as a limit that is not reached."""


_PUSH, _PUSH_TIME = (10.0, 30.0), (0.2, 0.5)
"""Ranges of a touch: largest force, N, and duration, s."""


class NotShownError(ValueError):
    """An effect has no size at which it shows as wanted, or the mechanism diverges with it.

    Args:
        name: Name of the effect, with its joint.
        message: The reason.
    """

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


@dataclass(frozen=True)
class BenchmarkMechanism:
    """A mechanism under test.

    Args:
        joints: Names of the joints.
        centre: Middle posture, rad, or m for prismatic joints. [N].
        reach: Largest commanded distance from the middle posture, rad or m. [N].
        noise: Standard deviation of one sample, by channel. Each [N].
        truth: Simulator of the true motion.
        sizes: Start size for the search of the unit, and its sign (0 for both), by the name of each effect that may be hidden.
        largest: Size beyond which an effect is an implausible fault, by the effect's name, with or without its joint.
        plain: Cache of motions without any effect, by role, seed of the courses, duration and rate. [T, N] each.
    """

    joints: tuple[str, ...]
    centre: Array
    reach: Array
    noise: Mapping[str, Array]
    truth: Truth
    sizes: Mapping[str, tuple[float, int]]
    largest: Mapping[str, float] = field(default_factory=dict)
    plain: dict[tuple[str, int, float, float], dict[str, Array]] = field(default_factory=dict, repr=False, compare=False)


@dataclass(frozen=True)
class DrawnCase:
    """A sealed truth and its records.

    Args:
        name: Name of the case.
        hidden: Sizes of the hidden effects, by name (`name:joint` for one joint); empty for an effect-free case.
        units: Size of each effect, in units of the detection limit.
        records: Records by role: `fit`, `select`, `verify`.
        clean: Channels of `verify` without noise and touch, at its sample times. Each [T, N].
        plain: Channels of `verify` without noise, touch and hidden effects. Each [T, N].
        seal: SHA-256 of the truth.
    """

    name: str
    hidden: Mapping[str, float]
    units: float
    records: Mapping[str, Record]
    clean: Mapping[str, Array]
    plain: Mapping[str, Array]
    seal: str


def draw_case(
    plant: BenchmarkMechanism,
    names: tuple[str, ...],
    units: float,
    seed: int,
    course_seed: int,
    *,
    duration: float = 4.0,
    rate: float = 100.0,
    kinds: tuple[str, ...] = ("position", "velocity", "effort"),
    spoil: str = "white",
    lost: float = 0.0,
    touched: bool = False,
) -> DrawnCase:
    """Draw one case.

    Args:
        plant: The mechanism.
        names: Names of the effects to hide.
        units: Size of each effect by itself, in units of the detection limit.
        seed: Seed of signs and noise.
        course_seed: Seed of the courses, which several cases may share.
        duration: Length of each record, s.
        rate: Sampling rate, Hz.
        kinds: Channels that are logged.
        spoil: Kind of noise, one of `gsbridge.gap.benchmark.noises.NOISES`.
        lost: Share of the samples that are missing from the logs.
        touched: Whether something pushes the mechanism for a moment of each record.

    Raises:
        NotShownError: An effect has no size at which it shows as wanted, or the mechanism diverges with it.
        InputError: The mechanism diverges with nothing hidden.
    """
    rng = np.random.default_rng(seed)
    times = np.arange(round(duration * rate)) / rate
    roads = np.random.default_rng(course_seed)
    courses = {role: _joined(course(kind, plant.centre, plant.reach, duration, roads), rate) for role, kind in KINDS.items()}

    def effect_free(role: str) -> dict[str, Array]:
        key = (role, course_seed, duration, rate)
        if key not in plant.plain:
            plant.plain[key] = plant.truth(courses[role], duration, times, {})
        return plant.plain[key]

    signs = {name: (float(plant.sizes[name][1]) or float(rng.choice((-1.0, 1.0)))) for name in names}
    hidden: dict[str, float] = {}
    if names:
        plain = effect_free("select")
        for name in names:
            size = size_of_units(plant, name, signs[name], units, courses["select"], duration, times, kinds, plain)
            hidden[name] = signs[name] * size
    text = json.dumps({"seed": seed, "hidden": dict(sorted(hidden.items()))})
    made, clean, kept = {}, {}, np.ones(len(times), bool)
    for role, wanted in courses.items():
        clean = plant.truth(wanted, duration, times, hidden) if hidden else effect_free(role)
        moved = plant.truth(wanted, duration, times, {**hidden, **_touch(duration, rng)}) if touched else clean
        if not all(np.isfinite(values[kind]).all() for values in (clean, moved) for kind in kinds):
            if not names:
                raise InputError("benchmark", f"the mechanism runs away on '{role}' with nothing hidden", "Take other courses")
            raise NotShownError(names[-1], f"'{role}' runs away with {' and '.join(names)}")
        if role != "verify" and _length(plant, clean, effect_free(role), kinds) < _SHARE * units * np.sqrt(UNIT):
            raise NotShownError(names[-1], f"{' and '.join(names)} hardly show on '{role}'")
        measured = {kind: spoiled(moved[kind], plant.noise[kind], spoil, rng) for kind in kinds}
        if lost:
            kept = rng.random(len(times)) >= lost
            kept[[0, -1]] = True
        sent = np.array([wanted(t) for t in times[kept]])
        measured = {kind: values[kept] for kind, values in measured.items()}
        made[role] = Record(role, times[kept], plant.joints, {"command": sent}, measured)
    # `clean` and `kept` come from the last turn of the loop, which is `verify`.
    clean, plain = ({kind: values[kind][kept] for kind in kinds} for values in (clean, effect_free("verify")))
    return DrawnCase("+".join(names) or "none", hidden, units, made, clean, plain, hashlib.sha256(text.encode()).hexdigest())


def _touch(duration: float, rng: np.random.Generator) -> dict[str, float]:
    """Draw a touch: time (s), duration (s) and force (N) of a push, as inputs of a simulator."""
    way = rng.normal(size=3)
    x, y, z = rng.uniform(*_PUSH) * way / np.linalg.norm(way)
    length = float(rng.uniform(*_PUSH_TIME))
    return {"touch_at": float(rng.uniform(0.2, 0.7)) * duration, "touch_for": length, "touch_x": x, "touch_y": y, "touch_z": z}


def _joined(wanted: Course, rate: float) -> Course:
    """Sample a course at a rate, Hz, and interpolate linearly between samples, as the motors' controller does."""
    sent = functools.cache(lambda number: wanted(number / rate))

    def joined(time: float) -> Array:
        place = time * rate
        whole = math.floor(place)
        return sent(whole) + (place - whole) * (sent(whole + 1) - sent(whole))

    return joined


def size_of_units(
    plant: BenchmarkMechanism,
    name: str,
    sign: float,
    units: float,
    wanted: Course,
    duration: float,
    times: Array,
    kinds: tuple[str, ...],
    plain: Mapping[str, Array],
) -> float:
    """Find the size at which the noise-free signature on `select` has the squared length `units`^2 times `UNIT`.

    Args:
        plant: The mechanism.
        name: Name of the effect, `name:joint` for one joint.
        sign: Sign of the size, 1 or -1.
        units: Wanted size in units of the detection limit.
        wanted: Course of `select`.
        duration: Length of the course, s.
        times: Times of the samples, s. [T].
        kinds: Channels that are logged.
        plain: Channels of the same course with nothing hidden. Each [T, N].

    Returns:
        The size without its sign, in the effect's own unit.

    Raises:
        NotShownError: There is no such plausible size: the effect shows too little in these courses, or jumps past the wanted
            length.
    """

    def length(size: float) -> float:
        return _length(plant, plant.truth(wanted, duration, times, {name: sign * size}), plain, kinds)

    aim, size = units * np.sqrt(UNIT), plant.sizes[name][0]
    low, high = (0.0, 0.0), (np.inf, np.inf)
    side, stay, most = 0, False, plant.largest.get(name, plant.largest.get(name.split(":")[0], np.inf))
    for _ in range(_TRIES):
        size = min(size, most)
        found = length(size)
        if abs(found / aim - 1.0) < 0.05:
            return size
        above = not found < aim
        # If the same side of the bracket moves twice in a row, bisect next; otherwise the search would converge slowly.
        side, stay = (1 if above else -1), side == (1 if above else -1)
        low, high = (low, (size, found)) if above else ((size, found), high)
        if low[0] >= most:
            break
        size = _between(low, high, aim, stay)
    raise NotShownError(name, f"{name} reaches no {units:g} units in these courses")


def _length(plant: BenchmarkMechanism, moved: Mapping[str, Array], plain: Mapping[str, Array], kinds: tuple[str, ...]) -> float:
    """Return the length of a noise-free signature, in units of the noise, limited to the weight of `_LONGEST` samples."""
    count = len(moved[kinds[0]])
    length = float(np.sqrt(sum((((moved[kind] - plain[kind]) / plant.noise[kind]) ** 2).sum() for kind in kinds)))
    return length * min(1.0, float(np.sqrt(_LONGEST / count)))


def _between(low: tuple[float, float], high: tuple[float, float], aim: float, halve: bool) -> float:
    """Interpolate between a size that is too small and one that is too large, by a power law; bisect if `halve`.

    Args:
        low: Size that is too small, and its length.
        high: Size that is too large, and its length.
        aim: Wanted length.
        halve: Whether to bisect.
    """
    if not np.isfinite(high[0]):
        return low[0] * float(np.clip(aim / max(low[1], 1e-9), 1.02, 8.0))
    if low[0] <= 0.0:
        return high[0] * (float(np.clip(aim / high[1], 0.1, 0.98)) if np.isfinite(high[1]) else 0.5)
    share = 0.5
    if low[1] > 0.0 and np.isfinite(high[1]) and not halve:
        share = float(np.clip(np.log(aim / low[1]) / np.log(high[1] / low[1]), 0.05, 0.95))
    return float(low[0] * (high[0] / low[0]) ** share)
