"""Plan of the cases of a tier: a fixed mix of easy and hard ones, drawn by split and seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.gap.benchmark.noises import NOISES

TIERS = ("t0", "t1", "t2", "t4", "t5", "t7")
"""Tiers of drawn cases: a single axis simulated by its equation of motion (t0); an arm simulated in PyBullet (t1) or in MuJoCo
(t2); photos (t4); thrown bodies (t5) and further machines with various record lengths and rates (t7), both in MuJoCo. T3 are
measured logs, whose truth nobody knows, and T6 are laws that are not ours (`benchmarks/gap_mismatch.py`)."""

IMAGES, BODIES, MACHINES = "t4", "t5", "t7"

SPLITS = ("development", "scored")
SCORED = SPLITS[1]
"""Thresholds may be tuned on `development`; only `scored` is reported. The splits differ in seeds, courses and sizes."""

TIER_SIZE = {"t0": 52, "t1": 164, "t2": 218, "t4": 64, "t5": 80, "t7": 80}

_FURTHER = {"t1": {"contact": 4, "tool": 4}, "t2": {"contact": 5, "tool": 5}}
"""Numbers of cases in a whole tier beyond its mix: something pushes the arm for a moment, or only its tool is logged."""

ALL_CHANNELS = ("position", "velocity", "effort")

_FREE = ("white", "coloured", "heavy", "understated", "quantised")

_MIX: tuple[tuple[str, int], ...] = (
    ("single", 2), ("free", 0), ("single", 3), ("unknown", 3), ("single", 2), ("free", 1), ("single", 0), ("pair", 2),
    ("free", 3), ("single", 3), ("no_effort", 3), ("single", 1), ("free", 0), ("single", 2), ("unknown", 2), ("free", 2),
    ("single", 3), ("triple", 3), ("free", 1), ("single", 2), ("short", 2), ("free", 4), ("single", 3), ("coloured", 3),
    ("free", 3), ("dropped", 3),
)  # fmt: skip
"""Kind of each case, and the index of its size in the split or, if effect-free, of its noise in `_FREE`. The mix repeats."""

_IMAGE_MIX: tuple[tuple[str, int], ...] = (
    ("free", 0), ("single", 2), ("single", 3), ("free", 0), ("unknown", 3), ("single", 2), ("free", 0), ("single", 3),
    ("free", 0), ("pair", 3), ("single", 1), ("free", 0), ("single", 2), ("unknown", 2), ("free", 0), ("single", 3),
)  # fmt: skip
"""Mix of cases of photos, with sizes as in `_MIX`; their noise is always that of a sensor."""

_BODY_MIX: tuple[tuple[str, int], ...] = (
    ("single", 3), ("single", 2), ("free", 0), ("single", 3), ("single", 2), ("unknown", 3), ("single", 3), ("pair", 3),
    ("single", 1), ("free", 0),
)  # fmt: skip
"""Mix of cases of thrown bodies, and of each further machine, with sizes as in `_MIX`."""

_SEALED = (1.0, 1.4)
"""Range of the random factor on each size of a sealed draw."""

_DRIFT = "clock_drift"
"""Effect that is hidden in addition in cases with lost samples."""

_LOST = 0.03
"""Share of the samples that these cases lose."""

_SHORTEST = 2.01
"""Shortest length of a record, s: its last sample is two seconds after the first."""

_UNITS = {"development": (1.4, 3.0, 7.0, 15.0), "scored": (1.0, 2.0, 5.0, 20.0)}

_IMAGE_UNITS = {"development": (3.0, 7.0, 30.0, 150.0), "scored": (2.0, 5.0, 20.0, 100.0)}
"""Sizes for photos. With so many pixels a unit is small: twenty units displace the image by a tenth of a pixel."""

_COURSES = {"development": (110, 111), "scored": (9110, 9111)}

_WORLDS = {"development": (120, 121, 122, 123), "scored": (9120, 9121, 9122, 9123)}
"""Seeds of the worlds that photos show."""


@dataclass(frozen=True)
class PlannedCase:
    """A case to draw.

    Args:
        key: Name of the case, which reveals nothing about it.
        kind: Kind of the case: `single`, `pair`, `triple`, `unknown`, `free`, or one effect with a difficulty: `no_effort`,
            `short` (record), `coloured` (noise), `dropped` (lost samples and a clock that drifts), `contact` (something
            pushes the arm) or `tool` (only the tool is logged).
        names: Names of the hidden effects.
        units: Size of each, in units of the detection limit.
        seed: Seed of signs and noise.
        course_seed: Seed of the courses, or of the world that photos show; cases that share it share a bank.
        channels: Channels that are logged.
        duration: Length of each record, s.
        noise: One of `gsbridge.gap.benchmark.noises.NOISES`; `sensor` for photos.
        lost: Share of the samples that are missing.
        touched: Whether something pushes the arm for a moment.
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
    """Seeds and sizes that belong to a split or to a seal.

    Args:
        key: Seed of what is drawn case by case.
        units: Sizes, in units of the detection limit.
        image_units: Sizes in photos, in the same units.
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
        """Return the seeds and sizes of a tier; a seal alone decides them if there is one.

        Args:
            tier: One of `TIERS`.
            split: One of `SPLITS`.
            seed: Seed of the draw.
            seal: The seal; None if split and seed decide.
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
    """Plan the cases of a tier.

    Args:
        tier: One of `TIERS`.
        split: One of `SPLITS`.
        names: Effects of the catalogue that may be hidden: `name`, or `name:joint` for each joint that may be chosen.
        strange: Effects outside the catalogue that may be hidden, in the same form.
        count: Number of cases; the tier's full number by default. A smaller count keeps the mix.
        seed: Seed of the draw.
        seal: Number that decides the draw instead of split and seed; see `gsbridge.experiment.seals`.
    """
    drawn = Draw.of(tier, split, seed, seal)
    whole = TIER_SIZE[tier] if count is None else count
    further = _FURTHER.get(tier, {}) if whole == TIER_SIZE[tier] else {}
    draw = {IMAGES: _photos, BODIES: _bodies, MACHINES: _bodies}.get(tier, _motions)
    orders = [*draw(whole - sum(further.values()), drawn, names, strange), *_further(further, drawn, names)]
    # Random numbers in the keys, so that a key reveals nothing about its case.
    places = np.random.default_rng([*drawn.key, 2]).permutation(whole)
    named = (replace(order, key=f"{tier}-{place:03d}") for order, place in zip(orders, places, strict=True))
    return tuple(sorted(named, key=lambda order: order.key))


def _motions(count: int, drawn: Draw, names: tuple[str, ...], strange: tuple[str, ...]) -> list[PlannedCase]:
    """Plan cases of an axis or an arm, without keys."""
    rng = np.random.default_rng(drawn.key)
    # Not used, but an earlier version drew numbers here; without this line, the cases would differ from that version's.
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
                # All cases of one turn of the mix share courses, and so a bank.
                drawn.courses[number // len(_MIX) % 2],
                ("position", "velocity") if kind == "no_effort" else ALL_CHANNELS,
                _SHORTEST if kind == "short" else 4.0,
                _FREE[which] if kind == "free" else "coloured" if kind == "coloured" else NOISES[0],
                _LOST if kind == "dropped" else 0.0,
            )
        )  # fmt: skip
    return out


def _further(counts: Mapping[str, int], drawn: Draw, names: tuple[str, ...]) -> list[PlannedCase]:
    """Plan cases beyond the mix, without keys; `counts` holds their number by kind."""
    rng = np.random.default_rng([*drawn.key, 1])
    known, out = _Deck(names, rng), []
    for kind, count in counts.items():
        for number in range(count):
            order = PlannedCase("", kind, known.draw(1), drawn.units[3], int(rng.integers(2**31)), drawn.courses[number % 2])
            alone = ("tool",) if kind == "tool" else ALL_CHANNELS
            out.append(replace(order, channels=alone, touched=kind == "contact"))
    return out


def _bodies(count: int, drawn: Draw, names: tuple[str, ...], strange: tuple[str, ...]) -> list[PlannedCase]:
    """Plan cases of thrown bodies or of further machines, without keys; those of one turn of the mix share a machine."""
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
    """Plan cases of photos, without keys."""
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
    """A shuffled deck of effects that is dealt and reshuffled, so that all effects are hidden about equally often."""

    def __init__(self, names: tuple[str, ...], rng: np.random.Generator) -> None:
        self._groups: dict[str, list[str]] = {}
        for name in names:
            self._groups.setdefault(name.split(":")[0], []).append(name)
        self._rng, self._waiting = rng, list[str]()

    def draw(self, count: int) -> tuple[str, ...]:
        """Draw names of `count` different effects, each at a random one of its joints."""
        out: list[str] = []
        while len(out) < count:
            if not self._waiting:
                self._waiting = [str(name) for name in self._rng.permutation(sorted(self._groups))]
            effect = self._waiting.pop()
            if all(effect != name.split(":")[0] for name in out):
                out.append(str(self._rng.choice(self._groups[effect])))
        return tuple(sorted(out))
