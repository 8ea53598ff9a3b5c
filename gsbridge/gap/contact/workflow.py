"""Stages of the workflow for a case about a thrown body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.contact import null
from gsbridge.gap.contact.bank import FEW, GridBank, grid_bank
from gsbridge.gap.contact.body import MODE, read_body
from gsbridge.gap.contact.case import ThrowCase, read_throw_case
from gsbridge.gap.contact.diagnose import ThrowAccount, diagnose_throws
from gsbridge.gap.contact.grid import grid_ways
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.residual_map import CHANNELS, along, cells, map_distances
from gsbridge.gap.contact.store import load_throws, save_throws
from gsbridge.gap.contact.throws import Throws
from gsbridge.gap.contact.world import Flight
from gsbridge.gap.diagnosis.backend import CaseBackend, stored_names
from gsbridge.gap.diagnosis.findings import similar_pairs
from gsbridge.gap.diagnosis.residual_map import ResidualMap
from gsbridge.geometry import Array


@dataclass(frozen=True)
class ThrowBackend(CaseBackend):
    """A case whose model is a thrown body; see `gsbridge.gap.diagnosis.backend.Backend`.

    Args:
        case: The case.
    """

    case: ThrowCase

    @classmethod
    def read(cls, path: str | Path) -> ThrowBackend:
        """Read a case from its file and check it.

        Raises:
            InputError: The case cannot be used.
        """
        return cls(read_throw_case(path))

    @classmethod
    def load(cls, model: str | Path, data: str | Path, about: Mapping[str, Any]) -> ThrowBackend:
        """Load a case of throws from the results of `save` and `about`.

        Args:
            model: File of the model.
            data: File that `save` wrote (`.npz`).
            about: The return value of `about`, read back from `records.json`.

        Raises:
            InputError: A file is missing or damaged.
        """
        body, throws = read_body(model), load_throws(data)
        return cls(ThrowCase(Path(model), body, throws, stored_names(about), about["horizon"], tuple(about["reasons"])))

    def save(self, data: str | Path) -> None:
        """Write the throws (`.npz`)."""
        save_throws(data, self.case.throws)

    def about(self) -> dict[str, Any]:
        """Return the content of `records.json`."""
        parts = {role: _about(role, items) for role, items in self.case.throws.items()}
        return self.described(self.case.body.digest(), MODE, parts, horizon=self.case.horizon)

    def _replay(self, role: str) -> ThrowReplay:
        return ThrowReplay(self.case.body, self.case.throws[role], self.case.horizon)

    def compare(self) -> dict[str, Any]:
        """Return the content of `comparison.json`: distances under the model as it is, and a map of where they show."""
        replays = {role: self._replay(role) for role in self.case.throws}
        return {
            "unit": ThrowAccount.unit,
            "records": {role: _distances(replay) for role, replay in replays.items()},
            "simulations": round(sum(replay.passes for replay in replays.values())),
        }

    def screen(self, bank: str | Path) -> dict[str, Any]:
        """Simulate the grids of all effects; return the content of `screen.json`: which effects the throws can tell apart."""
        replay = self._replay("fit")
        found = grid_bank(replay, self.case.names, bank)
        return {
            "candidates": list(found.names),
            "unseen": list(found.unseen(replay)),
            "signature_similarity": _alike(replay.part(FEW), found),
            "signatures": sum(len(way) for name in found.names for way in grid_ways(replay.body, name)),
            "simulations": round(found.runs),
        }

    def diagnose(self, bank: str | Path, seed: int) -> dict[str, Any]:
        """Diagnose the case; return the content of `findings.json`, tested on the third role."""
        case = self.case
        diagnosis = diagnose_throws(case.body, case.throws, bank, names=case.names, horizon=case.horizon, seed=seed)
        counts = {role: len(items) for role, items in case.throws.items()}
        return ThrowAccount().findings_of(diagnosis, case.throws, seed=seed, reasons=case.reasons, throws=counts)

    def replay(self, effects: Sequence[Applied]) -> tuple[dict[str, Array], dict[str, Any]]:
        """Replay all throws with the original model and with effects.

        Returns:
            Arrays `{role}/{what}` over all samples, throw after throw: index of the throw, time (s), measured, nominal and
            explained position (m) and attitude (wxyz), and distances before and after (m); without effects there is no
            `explained` and no `after`. And the content of `replays.json`: mean distances before and after (mm), names of the
            throws, and a map of what remains.
        """
        arrays: dict[str, Array] = {}
        rows, runs = {}, 0.0
        for role, throws in self.case.throws.items():
            replay = self._replay(role)
            counts = [len(time) for time in replay.times]
            arrays[f"{role}/throw"] = np.repeat(np.arange(len(counts)), counts)
            arrays[f"{role}/time"] = np.concatenate(replay.times)
            arrays[f"{role}/position"] = np.concatenate(replay.measured)
            arrays[f"{role}/quat"] = np.concatenate(
                [throw.quat[:count] for throw, count in zip(throws.items, counts, strict=True)]
            )
            for way, when, added in (("nominal", "before", ()), ("explained", "after", tuple(effects)))[: 2 if effects else 1]:
                flights = replay.flights(added)
                arrays[f"{role}/{way}_position"] = np.concatenate([flight.position for flight in flights])
                arrays[f"{role}/{way}_quat"] = np.concatenate([flight.quat for flight in flights])
                apart = arrays[f"{role}/{way}_position"] - arrays[f"{role}/position"]
                arrays[f"{role}/{when}"] = np.linalg.norm(apart, axis=1)
            rows[role] = {
                "before": 1e3 * float(replay.gaps().mean()),
                "after": 1e3 * float(replay.gaps(effects).mean()),
                "channels": list(CHANNELS),
                "throws": [throw.name for throw in throws.items],
                "phases": [replay.phases(), replay.phases(effects)],
                "remains": _map(replay, effects).record(),
            }
            runs += replay.passes
        return arrays, {"unit": ThrowAccount.unit, "records": rows, "simulations": round(runs)}


def _about(role: str, throws: Throws) -> dict[str, Any]:
    """Return a summary of the throws of a role for a reader."""
    steps = np.concatenate([np.diff(item.time) for item in throws.items])
    speeds = [kind for kind, key in (("velocity", "velocity"), ("angular_velocity", "spin")) if _logged(throws, key)]
    return {
        "name": throws.name or role,
        "throws": len(throws),
        "samples": sum(len(item.time) for item in throws.items),
        "seconds": sum(item.duration for item in throws.items),
        "rate_hz": 1.0 / float(np.median(steps)),
        "commands": [],
        "measured": ["position", "orientation", *speeds],
        "quantum": {},
        "digest": throws.digest or throws.content_digest(),
    }


def _logged(throws: Throws, key: str) -> bool:
    return all(getattr(item, key) is not None for item in throws.items)


def _map(replay: ThrowReplay, effects: Sequence[Applied] = ()) -> ResidualMap:
    """Map where the difference to a replay with effects shows, against replicates of a few throws with the same effects."""
    few = replay.part(null.FEW)
    sets, plain = null.replicates(few, effects, np.random.default_rng(0)), few.flights(effects)
    rows = [cells(few, [seen.position - at.position for seen, at in zip(row, plain, strict=True)]) for row in sets]
    return map_distances(replay, replay.flights(effects), np.stack(rows))


def _distances(replay: ThrowReplay) -> dict[str, Any]:
    """Return the distances of one role, and a map of where they show."""
    apart = [at - flight.position for flight, at in zip(replay.flights(), replay.measured, strict=True)]
    sizes = 1e3 * np.sqrt((np.concatenate(along(replay, apart)) ** 2).mean(axis=0))
    return {
        "whole": 1e3 * float(replay.gaps().mean()),
        "channels": dict(zip(CHANNELS, sizes.tolist(), strict=True)),
        "noise": dict.fromkeys(CHANNELS, replay.noise.position),
        "residual_map": _map(replay).record(),
    }


def _alike(few: ThrowReplay, bank: GridBank) -> list[dict[str, Any]]:
    """Return pairs of effects with similar signatures in these throws, over all their directions, the most similar first."""
    plain = _stack(few.flights())
    shapes = {}
    for name in bank.names:
        # Use the smallest size that shows: with large ones, chaos makes all effects look alike.
        rows = [[_stack(few.flights([applied])) - plain for applied in way] for way in grid_ways(few.body, name)]
        shown = [next((row for row in way if np.abs(row).mean() > few.noise.position), None) for way in rows]
        shapes[name] = np.array([row / np.linalg.norm(row) for row in shown if row is not None])
    names = [name for name in bank.names if len(shapes[name])]
    table = [[np.abs(shapes[one] @ shapes[other].T).max() for other in names] for one in names]
    return similar_pairs(names, np.array(table))


def _stack(flights: Sequence[Flight]) -> Array:
    return np.concatenate([flight.position for flight in flights]).ravel()
