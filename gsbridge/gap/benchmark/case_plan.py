"""Which cases a tier holds: a fixed mix of easy and hard ones, drawn by split and seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.gap.benchmark.noises import NOISES

TIERS = ("t0", "t1", "t2", "t4", "t5", "t7")
"""A single axis whose truth is an equation; an arm with truths of PyBullet; the same with truths of MuJoCo; photos; thrown
bodies; further machines, lengths and rates, these two with truths of MuJoCo. What is called T3 are measured logs, whose truth
nobody knows, and T6 laws that are not ours (`benchmarks/gap_mismatch.py`)."""

IMAGES, BODIES, MACHINES = "t4", "t5", "t7"

SPLITS = ("development", "scored")
SCORED = SPLITS[1]
"""Thresholds may be set on the first; only the second is reported. They differ in seeds, courses and sizes."""

TIER_SIZE = {"t0": 52, "t1": 164, "t2": 218, "t4": 64, "t5": 80, "t7": 80}

_FURTHER = {"t1": {"contact": 4, "tool": 4}, "t2": {"contact": 5, "tool": 5}}
"""Cases of a whole tier beside those of the mix: the arm touches something for a while; of the arm only its tool is seen."""

ALL_CHANNELS = ("position", "velocity", "effort")

_FREE = ("white", "coloured", "heavy", "understated", "quantised")

_MIX: tuple[tuple[str, int], ...] = (
    ("single", 2), ("free", 0), ("single", 3), ("unknown", 3), ("single", 2), ("free", 1), ("single", 0), ("pair", 2),
    ("free", 3), ("single", 3), ("no_effort", 3), ("single", 1), ("free", 0), ("single", 2), ("unknown", 2), ("free", 2),
    ("single", 3), ("triple", 3), ("free", 1), ("single", 2), ("short", 2), ("free", 4), ("single", 3), ("coloured", 3),
    ("free", 3), ("dropped", 3),
)  # fmt: skip
"""Kind of each case, and which of a split's sizes it has, or which noise for an effect-free one; repeated."""

_IMAGE_MIX: tuple[tuple[str, int], ...] = (
    ("free", 0), ("single", 2), ("single", 3), ("free", 0), ("unknown", 3), ("single", 2), ("free", 0), ("single", 3),
    ("free", 0), ("pair", 3), ("single", 1), ("free", 0), ("single", 2), ("unknown", 2), ("free", 0), ("single", 3),
)  # fmt: skip
"""Mix of cases of photos; their noise is always that of a sensor."""

_BODY_MIX: tuple[tuple[str, int], ...] = (
    ("single", 3), ("single", 2), ("free", 0), ("single", 3), ("single", 2), ("unknown", 3), ("single", 3), ("pair", 3),
    ("single", 1), ("free", 0),
)  # fmt: skip
"""Mix of cases of thrown bodies, and of each further machine."""

_SEALED = (1.0, 1.4)
"""Range of the factor on the sizes of a sealed draw."""

_DRIFT = "clock_drift"
"""What is hidden where samples are lost, beside something else."""

_LOST = 0.03
"""Share of the samples that are lost there."""

_SHORTEST = 2.01
"""Shortest length of a record, s: its last sample is two seconds after the first."""

_UNITS = {"development": (1.4, 3.0, 7.0, 15.0), "scored": (1.0, 2.0, 5.0, 20.0)}

_IMAGE_UNITS = {"development": (3.0, 7.0, 30.0, 150.0), "scored": (2.0, 5.0, 20.0, 100.0)}
"""Sizes for photos: their many pixels make a unit so small that twenty of them move a camera by a tenth of a pixel."""

_COURSES = {"development": (110, 111), "scored": (9110, 9111)}

_WORLDS = {"development": (120, 121, 122, 123), "scored": (9120, 9121, 9122, 9123)}
"""Seeds of the worlds that photos show."""


@dataclass(frozen=True)
class PlannedCase:
    """A case to be drawn.

    Args:
        key: Name of the case, which says nothing about it.
        kind: What it tries: `single`, `pair`, `triple`, `unknown`, `free`, or a single effect under a difficulty: no efforts, a
            short record, coloured noise, samples that were lost beside a clock that drifts, an arm that touches something,
            or one of which only the tool is seen.
        names: What is hidden.
        units: Size of each.
        seed: Seed of signs and noise.
        course_seed: Seed of the courses, or of the world that photos show; cases that share it share a bank.
        channels: Logged ones.
        duration: Length of each record, s.
        noise: One of `gsbridge.gap.benchmark.noises.NOISES`.
        lost: Share of the samples that are missing.
        touched: Whether the arm touches something for a while.
    """

    key: str
    kind: str
    names: tuple[str, ...]
    units: float
    seed: int
    course_seed: int
    channels: tuple[str, ...] = ALL_CHANNELS
    duration: float = 4.0
    noise: str = "white"
    lost: float = 0.0
    touched: bool = False


@dataclass(frozen=True)
class Draw:
    """Numbers that a split, or a seal, stands for.

    Args:
        key: Seed of what is drawn case by case.
        units: Sizes.
        image_units: Sizes in photos.
        courses: Seeds of the courses that arms follow.
        worlds: Seeds of the worlds that photos show.
    """

    key: tuple[int, ...]
    units: tuple[float, ...]
    image_units: tuple[float, ...]
    courses: tuple[int, ...]
    worlds: tuple[int, ...]

    @classmethod
    def of(cls, tier: str, split: str, seed: int, seal: int | None) -> Draw:
        """What is drawn in a tier: from the seal alone where there is one.

        Args:
            tier: One of `TIERS`.
            split: One of `SPLITS`.
            seed: Seed of the draw.
            seal: The seal; None where split and seed decide.
        """
        number = TIERS.index(tier)
        if seal is None:
            sizes = _UNITS[split], _IMAGE_UNITS[split], _COURSES[split], _WORLDS[split]
            return cls((number, SPLITS.index(split), seed), *sizes)
        rng = np.random.default_rng([seal, number, len(SPLITS)])

        def drawn(sizes: tuple[float, ...]) -> tuple[float, ...]:
            return tuple(float(size * rng.uniform(*_SEALED)) for size in sizes)

        units, image_units = drawn(_UNITS["scored"]), drawn(_IMAGE_UNITS["scored"])
        courses, worlds = ([int(value) for value in rng.integers(10**6, 2**31, count)] for count in (2, 4))
        return cls((number, len(SPLITS), seal), units, image_units, tuple(courses), tuple(worlds))


def plan_cases(
    tier: str,
    split: str,
    names: tuple[str, ...],
    strange: tuple[str, ...],
    count: int | None = None,
    seed: int = 0,
    seal: int | None = None,
) -> tuple[PlannedCase, ...]:
    """The cases of a tier.

    Args:
        tier: One of `TIERS`.
        split: One of `SPLITS`.
        names: What may be hidden and is in the catalogue, by effect: `name`, or `name:joint` to choose a joint of.
        strange: Names of what may be hidden and is in no catalogue.
        count: Cases; the tier's full number by default. A smaller count keeps the mix.
        seed: Seed of the draw.
        seal: Number that alone decides what is drawn, instead of split and seed; see `gsbridge.experiment.seals`.
    """
    drawn = Draw.of(tier, split, seed, seal)
    whole = TIER_SIZE[tier] if count is None else count
    further = _FURTHER.get(tier, {}) if whole == TIER_SIZE[tier] else {}
    draw = {IMAGES: _photos, BODIES: _bodies, MACHINES: _bodies}.get(tier, _motions)
    orders = [*draw(whole - sum(further.values()), drawn, names, strange), *_further(further, drawn, names)]
    # Numbers that say nothing about a case.
    places = np.random.default_rng([*drawn.key, 2]).permutation(whole)
    named = (replace(order, key=f"{tier}-{place:03d}") for order, place in zip(orders, places, strict=True))
    return tuple(sorted(named, key=lambda order: order.key))


def _motions(count: int, drawn: Draw, names: tuple[str, ...], strange: tuple[str, ...]) -> list[PlannedCase]:
    """Cases of an axis or an arm, without keys."""
    rng = np.random.default_rng(drawn.key)
    # Numbers were drawn here once: without them, the arms' cases would be others than those of earlier versions.
    rng.permutation(count)
    known, odd = _Deck(names, rng), _Deck(strange, rng)
    out = []
    for number in range(count):
        kind, which = _MIX[number % len(_MIX)]
        units = 0.0 if kind == "free" else drawn.units[which]
        many = {"pair": 2, "triple": 3, "free": 0}.get(kind, 1)
        hidden = odd.draw(1) if kind == "unknown" else known.draw(many)
        while kind == "dropped" and hidden == (_DRIFT,):
            hidden = known.draw(1)
        hidden = tuple(sorted((*hidden, _DRIFT))) if kind == "dropped" else hidden
        out.append(
            PlannedCase(
                "", kind, hidden, units, int(rng.integers(2**31)),
                # Block by block, so that a few cases share one bank.
                drawn.courses[number // len(_MIX) % 2],
                ("position", "velocity") if kind == "no_effort" else ALL_CHANNELS,
                _SHORTEST if kind == "short" else 4.0,
                _FREE[which] if kind == "free" else "coloured" if kind == "coloured" else NOISES[0],
                _LOST if kind == "dropped" else 0.0,
            )
        )  # fmt: skip
    return out


def _further(counts: Mapping[str, int], drawn: Draw, names: tuple[str, ...]) -> list[PlannedCase]:
    """Cases beside the mix, without keys: how many of each kind."""
    rng = np.random.default_rng([*drawn.key, 1])
    known, out = _Deck(names, rng), []
    for kind, count in counts.items():
        for number in range(count):
            order = PlannedCase("", kind, known.draw(1), drawn.units[3], int(rng.integers(2**31)), drawn.courses[number % 2])
            alone = ("tool",) if kind == "tool" else ALL_CHANNELS
            out.append(replace(order, channels=alone, touched=kind == "contact"))
    return out


def _bodies(count: int, drawn: Draw, names: tuple[str, ...], strange: tuple[str, ...]) -> list[PlannedCase]:
    """Cases of thrown bodies or of further machines, without keys; those of one block share a machine."""
    rng = np.random.default_rng(drawn.key)
    known, odd = _Deck(names, rng), _Deck(strange, rng)
    out = []
    for number in range(count):
        kind, which = _BODY_MIX[number % len(_BODY_MIX)]
        hidden = odd.draw(1) if kind == "unknown" else known.draw({"pair": 2, "free": 0}.get(kind, 1))
        units = 0.0 if kind == "free" else drawn.units[which]
        site = drawn.courses[0] + number // len(_BODY_MIX)
        out.append(PlannedCase("", kind, hidden, units, int(rng.integers(2**31)), site))
    return out


def _photos(count: int, drawn: Draw, names: tuple[str, ...], strange: tuple[str, ...]) -> list[PlannedCase]:
    """Cases of photos, without keys."""
    rng = np.random.default_rng(drawn.key)
    known, odd = _Deck(names, rng), _Deck(strange, rng)
    out = []
    for number in range(count):
        kind, which = _IMAGE_MIX[number % len(_IMAGE_MIX)]
        many = {"pair": 2, "free": 0}.get(kind, 1)
        hidden = odd.draw(1) if kind == "unknown" else known.draw(many)
        units = 0.0 if kind == "free" else drawn.image_units[which]
        world = drawn.worlds[number // len(_IMAGE_MIX) % len(drawn.worlds)]
        out.append(PlannedCase("", kind, hidden, units, int(rng.integers(2**31)), world, (), 0.0, "sensor"))
    return out


class _Deck:
    """Names dealt one after the other in a drawn order, so that all come up equally often."""

    def __init__(self, names: tuple[str, ...], rng: np.random.Generator) -> None:
        self._groups: dict[str, list[str]] = {}
        for name in names:
            self._groups.setdefault(name.split(":")[0], []).append(name)
        self._rng, self._waiting = rng, list[str]()

    def draw(self, count: int) -> tuple[str, ...]:
        """Names of different effects."""
        out: list[str] = []
        while len(out) < count:
            if not self._waiting:
                self._waiting = [str(name) for name in self._rng.permutation(sorted(self._groups))]
            effect = self._waiting.pop()
            if all(effect != name.split(":")[0] for name in out):
                out.append(str(self._rng.choice(self._groups[effect])))
        return tuple(sorted(out))
