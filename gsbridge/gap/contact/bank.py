"""Bank of grids: simulations of a few throws with each effect at several sizes, made once per body and throws, kept on disk."""

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
"""Number of throws of `fit` on which grids are simulated."""


@dataclass(frozen=True)
class GridBank:
    """Simulated grids of effects.

    Args:
        names: Names of the effects.
        matches: The best grid point of each effect, the best first.
        runs: Number of simulations needed to make the bank, in passes over all throws of the role.
    """

    names: tuple[str, ...]
    matches: tuple[GridMatch, ...]
    runs: float

    def seen(self, replay: ThrowReplay) -> list[GridMatch]:
        """Return the matches of effects that move the replay of these throws by more than noise, the best first."""
        return [match for match in self.matches if match.change > 3.0 * replay.noise.position]

    def unseen(self, replay: ThrowReplay) -> tuple[str, ...]:
        """Return the names of the effects that do not show in these throws."""
        return tuple(sorted(set(self.names) - {match.effect.name for match in self.seen(replay)}))


def grid_bank(replay: ThrowReplay, names: Collection[str] | None, folder: str | Path) -> GridBank:
    """Simulate the grids of all effects on `FEW` of the throws, or read them from `folder`.

    Args:
        replay: Throws of `fit`; the part with `FEW` of them caches every grid point.
        names: Effects to consider; None for all effects of a body.
        folder: Folder that keeps banks from run to run.
    """
    few, who = replay.part(FEW), body_effects(replay, names)
    path = Path(folder) / f"{_key(few, who)}.npz"
    points = [(), *((applied,) for name in who for way in grid_ways(few.body, name) for applied in way)]
    keys = {tuple(body_setup(few.body, effects).figures.values()): effects for effects in points}
    found = _read(path, len(keys)) if path.exists() else None
    if found is None:
        before = few.runs
        found = np.stack([_rows(few.flights(effects)) for effects in keys.values()]).astype(np.float32)
        # Do not count these simulations here: they are reported as the bank's, whether it is made or read.
        few.runs = before
        with atomic_file(path) as temporary, open(temporary, "wb") as stream:
            np.savez_compressed(stream, flights=found)
    counts = np.cumsum([len(time) for time in few.times])[:-1]
    # New flights are replaced by their stored (float32) values, too, so that making and reading a bank give equal results.
    few.remember({key: _flights(rows, counts) for key, rows in zip(keys, found, strict=True)})
    matches = sorted((screen(few, name) for name in who), key=lambda match: match.error)
    return GridBank(who, tuple(matches), len(keys) * len(few) / len(replay))


@functools.cache
def _edition() -> str:
    """Return the digest of the code that makes a bank (effects and simulation), so that flights of other code are not read."""
    return code_digest(__name__)


def _key(few: ThrowReplay, who: Collection[str]) -> str:
    """Return the digest of all that a bank depends on."""
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
    """Return positions, attitudes and touch of all samples, throw after throw. [S, 8]."""
    parts = [np.concatenate([f.position, f.quat, f.touched[:, None]], axis=1) for f in flights]
    return np.concatenate(parts)


def _flights(rows: Array, edges: Array) -> list[Flight]:
    parts = np.split(rows.astype(np.float64), edges)
    return [Flight(part[:, :3], part[:, 3:7], part[:, 7] > 0.5) for part in parts]


def _read(path: Path, count: int) -> Array | None:
    """Read a bank's flights; delete a damaged bank and return None."""
    try:
        with np.load(path) as data:
            found = data["flights"]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        found = np.empty(0)
    if len(found) == count:
        return found
    path.unlink()
    return None
