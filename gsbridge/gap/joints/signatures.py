"""Signatures of effects: the change that an effect of one size makes in a replay."""

from __future__ import annotations

from dataclasses import dataclass

from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.geometry import Array


@dataclass(frozen=True)
class Signature:
    """Change of a replay by a candidate of one size.

    Args:
        candidate: The candidate.
        values: Parameters of the effect.
        change: Replay with the effect less the replay without, SI units. [T, C].
    """

    candidate: Candidate
    values: dict[str, float]
    change: Array


@dataclass(frozen=True)
class SignatureBank:
    """Signatures of all candidates on one record.

    Args:
        signatures: All signatures, by candidate and size.
        runs: Simulations that making the bank took.
        diverged: Candidates of which simulations diverged and no signature is left.
    """

    signatures: tuple[Signature, ...]
    runs: int
    diverged: tuple[Candidate, ...] = ()
