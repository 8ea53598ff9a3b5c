"""The bank of signatures of all candidates at several sizes; it is made once per mechanism and commands."""

from __future__ import annotations

import functools
import hashlib
import json
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gsbridge.digests import code_digest
from gsbridge.effects.registry import Applied
from gsbridge.files import atomic_file
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.signatures import Signature, SignatureBank
from gsbridge.geometry import Array

_AIM = 100.0
"""Squared length that the smallest signature should have, in units of the noise: ten times the noise of one number."""

_TRIES = 8
"""Most simulations spent on finding the smallest size along one direction."""

_COARSE = 2.0
"""Step, in doublings, to which the noise is rounded, so that cases with similar noise share a bank."""

_LARGEST = 2e4
"""Largest multiple of an effect's typical size that is tried."""


def make_bank(view: JointResiduals, who: Sequence[Candidate], base: Sequence[Applied] = ()) -> SignatureBank:
    """Simulate all candidates on top of `base`.

    The noise of the view sets the smallest size of each: that at which the signature just stands out.

    Args:
        view: The record, the mechanism that replays it, and the noise.
        who: Candidates.
        base: Effects that are part of the replay already.
    """
    before = view.mechanism.runs
    plain = view.stack(view.simulate(base))
    found: list[Signature] = []
    diverged = []
    for candidate in who:
        factor, thrown = 1.0, False
        for direction in candidate.directions():
            # The smallest visible size along one direction is a good first guess for the next direction.
            made, factor, lost = _along(view, candidate, direction, factor, plain, base)
            found += made
            thrown |= lost
        if thrown and all(signature.candidate != candidate for signature in found):
            diverged.append(candidate)
    return SignatureBank(tuple(found), view.mechanism.runs - before, tuple(diverged))


def _along(
    view: JointResiduals, candidate: Candidate, direction: dict[str, float], begin: float, plain: Array, base: Sequence[Applied]
) -> tuple[list[Signature], float, bool]:
    """Make signatures along one direction of a candidate's parameters.

    Returns:
        The signatures, the multiple of the direction at which they just stand out, and whether a simulation diverged.
    """
    effect = candidate.effect

    def change(factor: float) -> tuple[dict[str, float], Array, float]:
        values = effect.scaled(direction, factor)
        difference = view.stack(view.simulate((*base, candidate.applied(values)))) - plain
        if not np.isfinite(difference).all():
            return values, difference, np.inf
        return values, difference, float((view.whiten(difference) ** 2).sum())

    factor, seen = begin, {}
    low, high = 0.0, np.inf
    for _ in range(0 if effect.fixed else _TRIES):
        seen[factor] = change(factor)
        size = seen[factor][2]
        if 0.3 * _AIM <= size <= 5 * _AIM:
            break
        low, high = (max(low, factor), high) if size < _AIM else (low, min(high, factor))
        if size == np.inf:
            scale = 0.1
        elif size < 1e-3 * _AIM:
            # Effects with a threshold (limits, play) change nothing below it: take a large step.
            scale = 8.0
        else:
            scale = float(np.clip(np.sqrt(_AIM / size), 0.05, 20.0))
        new = factor * scale
        if not low < new < high:
            new = float(np.sqrt(low * high))
        if new in seen or new > _LARGEST or effect.scaled(direction, new) == effect.scaled(direction, factor):
            break
        factor = new
    out, last = [], None
    for step in effect.sizes:
        values, difference, size = seen[factor * step] if factor * step in seen else change(factor * step)
        if values == last or size == np.inf:
            break
        last = values
        if size > 1.0:
            out.append(Signature(candidate, values, difference.astype(np.float32)))
    return out, factor if out else begin, any(size == np.inf for _, _, size in seen.values())


@functools.cache
def _edition() -> str:
    """Return a digest of the code that makes a bank, effects and simulation included, so that no outdated bank is read."""
    return code_digest(__name__)


def signature_bank(view: JointResiduals, who: Sequence[Candidate], folder: str | Path) -> SignatureBank:
    """Return the bank of signatures of a record, read from `folder` if an equal one was made before.

    Args:
        view: The record, the mechanism that replays it, and the noise.
        who: Candidates.
        folder: Where banks are kept; a new bank is written there.
    """
    # The noise only sets the sizes, where a factor of two does not matter: rounded, it lets cases of one sensor share a bank.
    steps = np.round(np.log2(view.sigma) / _COARSE)
    key = hashlib.sha256(f"{_edition()}{view.digest()}".encode())
    for candidate in who:
        effect = candidate.effect
        key.update(f"{candidate}{effect.parameters}{candidate.directions()}{effect.sizes}".encode())
    key.update(steps.astype(int).tobytes())
    path = Path(folder) / f"{key.hexdigest()[:32]}.npz"
    if path.exists():
        try:
            return _read(path, who)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            path.unlink()
    # Use the rounded noise, so that a bank does not depend on which case made it.
    coarse = replace(view)
    coarse.set_noise(2.0 ** (_COARSE * steps), view.records)
    bank = make_bank(coarse, who)
    shape = view.stack(view.record.measured).shape
    changes = np.stack([s.change for s in bank.signatures]) if bank.signatures else np.empty((0, *shape))
    labels = json.dumps([[s.candidate.name, s.candidate.joint, s.values] for s in bank.signatures])
    with atomic_file(path) as temporary, open(temporary, "wb") as stream:
        lost = json.dumps([[who.name, who.joint] for who in bank.diverged])
        np.savez_compressed(stream, changes=changes, labels=labels, runs=bank.runs, diverged=lost)
    return bank


def _read(path: Path, who: Sequence[Candidate]) -> SignatureBank:
    known = {(candidate.name, candidate.joint): candidate for candidate in who}
    with np.load(path) as data:
        labels, changes = json.loads(str(data["labels"])), data["changes"]
        found = tuple(
            Signature(known[name, joint], values, change) for (name, joint, values), change in zip(labels, changes, strict=True)
        )
        diverged = tuple(known[name, joint] for name, joint in json.loads(str(data["diverged"])))
        return SignatureBank(found, int(data["runs"]), diverged)
