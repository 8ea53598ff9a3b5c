"""Bank of grids: what each effect makes of a few throws, at several sizes; made once per body and throws, kept in a folder."""

from __future__ import annotations

import functools
import hashlib
import zipfile
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.digests import code_digest
from gsbridge.files import atomic_file
from gsbridge.gap.contact.grid import grid_ways
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.search import GridMatch, body_effects, screen
from gsbridge.gap.contact.setup import body_setup
from gsbridge.gap.contact.world import Flight
from gsbridge.geometry import Array

FEW = 20
"""Throws of `fit` on which grids are walked."""


@dataclass(frozen=True)
class GridBank:
    """Grids that were walked.

    Args:
        names: Effects that were looked at.
        matches: The best point of each, the best first.
        runs: Simulations that making it took, in passes over all throws of the role.
    """

    names: tuple[str, ...]
    matches: tuple[GridMatch, ...]
    runs: float

    def seen(self, replay: ThrowReplay) -> list[GridMatch]:
        """Effects that move the replay of these throws by more than noise, the best first."""
        return [match for match in self.matches if match.change > 3.0 * replay.noise.position]

    def unseen(self, replay: ThrowReplay) -> tuple[str, ...]:
        """Names of the effects that do not show in these throws."""
        return tuple(sorted(set(self.names) - {match.effect.name for match in self.seen(replay)}))


def grid_bank(replay: ThrowReplay, names: Collection[str] | None, folder: str | Path) -> GridBank:
    """Walk the grids of all effects on the first throws, from `folder` where that was done before.

    Args:
        replay: Throws of `fit`; its part of `FEW` throws remembers every point.
        names: Effects that may be the reason; None for all of a body.
        folder: Keeps banks from run to run.
    """
    few, who = replay.part(FEW), body_effects(replay, names)
    path = Path(folder) / f"{_key(few, who)}.npz"
    points = [(), *((applied,) for name in who for way in grid_ways(few.body, name) for applied in way)]
    keys = {tuple(body_setup(few.body, effects).figures.values()): effects for effects in points}
    found = _read(path, len(keys)) if path.exists() else None
    if found is None:
        before = few.runs
        found = np.stack([_rows(few.flights(effects)) for effects in keys.values()]).astype(np.float32)
        # They count as the bank's, whoever happens to make it.
        few.runs = before
        with atomic_file(path) as temporary, open(temporary, "wb") as stream:
            np.savez_compressed(stream, flights=found)
    counts = np.cumsum([len(time) for time in few.times])[:-1]
    # Those that were just made are replaced too, so that a bank that was read gives the same figures.
    few.remember({key: _flights(rows, counts) for key, rows in zip(keys, found, strict=True)})
    matches = sorted((screen(few, name) for name in who), key=lambda match: match.error)
    return GridBank(who, tuple(matches), len(keys) * len(few) / len(replay))


@functools.cache
def _edition() -> str:
    """Digest of the code that makes a bank, effects and simulation included: no flight that other code made is read."""
    return code_digest(__name__)


def _key(few: ThrowReplay, who: Collection[str]) -> str:
    """Digest of all that a bank depends on."""
    total = hashlib.sha256(f"{_edition()} {few.body.digest()} {few.horizon} {list(who)}".encode())
    for path in few.body.meshes:
        total.update(path.read_bytes())
    for throw in few.throws.items:
        for values in (throw.time, throw.position, throw.quat, throw.velocity, throw.spin):
            total.update(b"-" if values is None else np.ascontiguousarray(values).tobytes())
    for name in who:
        total.update(repr([[applied.record() for applied in way] for way in grid_ways(few.body, name)]).encode())
    return total.hexdigest()[:32]


def _rows(flights: list[Flight]) -> Array:
    """Positions, attitudes and touch of all samples. [S, 8]."""
    parts = [np.concatenate([f.position, f.quat, f.touched[:, None]], axis=1) for f in flights]
    return np.concatenate(parts)


def _flights(rows: Array, edges: Array) -> list[Flight]:
    parts = np.split(rows.astype(np.float64), edges)
    return [Flight(part[:, :3], part[:, 3:7], part[:, 7] > 0.5) for part in parts]


def _read(path: Path, count: int) -> Array | None:
    """What a bank holds; None where it is damaged, and then it goes."""
    try:
        with np.load(path) as data:
            found = data["flights"]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        found = np.empty(0)
    if len(found) == count:
        return found
    path.unlink()
    return None
