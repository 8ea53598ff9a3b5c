"""Signatures of effects: what each changes in a replay, at one size."""

from __future__ import annotations

from dataclasses import dataclass

from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.geometry import Array


@dataclass(frozen=True)
class Signature:
    """Change of a replay by a candidate of one size.

    Args:
        candidate: Who.
        values: Parameters of the effect.
        change: Simulated with it less without, SI units. [T, C].
    """

    candidate: Candidate
    values: dict[str, float]
    change: Array


@dataclass(frozen=True)
class SignatureBank:
    """Signatures of all candidates on one record.

    Args:
        signatures: All, by candidate and size.
        runs: Simulations that making it took.
        diverged: Candidates with which no simulation ran through.
    """

    signatures: tuple[Signature, ...]
    runs: int
    diverged: tuple[Candidate, ...] = ()
