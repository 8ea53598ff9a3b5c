"""Screening: how much of a residual each candidate's signatures explain, and which candidates look alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.bank import Bank, Signature
from gsbridge.gap.candidates import Candidate
from gsbridge.gap.view import View
from gsbridge.geometry import Array

_STRETCH = (0.4, 2.5)
"""Factors by which a signature of one size may stand for neighbouring sizes."""


@dataclass(frozen=True)
class Match:
    """How well a candidate explains a residual before any fit.

    Args:
        candidate: Who.
        gain: Squared residual that it removes, in units of the noise.
        cosine: Of the angle between residual and signature.
        starts: Parameters to start a fit from, best first.
    """

    candidate: Candidate
    gain: float
    cosine: float
    starts: tuple[dict[str, float], ...]


def screen(view: View, bank: Bank, residual: Array, starts: int = 3) -> list[Match]:
    """Candidates, the best first.

    Args:
        view: Of the record that the bank belongs to.
        bank: Signatures.
        residual: Whitened. [T, C].
        starts: Starts kept per candidate.
    """
    flat = residual.ravel()
    length = float(np.linalg.norm(flat))
    rows: dict[Candidate, list[tuple[float, float, dict[str, float]]]] = {}
    for signature in bank.signatures:
        shape = view.whiten(signature.change.astype(np.float64)).ravel()
        size, along = float(shape @ shape), float(shape @ flat)
        if size == 0.0:
            continue
        factor = float(np.clip(along / size, *_STRETCH))
        gain = 2 * factor * along - factor**2 * size
        values = signature.candidate.effect.scaled(signature.values, factor)
        rows.setdefault(signature.candidate, []).append((gain, along / np.sqrt(size) / max(length, 1e-12), values))
    out = []
    for candidate, found in rows.items():
        found.sort(key=lambda item: -item[0])
        out.append(Match(candidate, found[0][0], found[0][1], tuple(item[2] for item in found[:starts])))
    return sorted(out, key=lambda match: -match.gain)


def cosines(view: View, signatures: Sequence[Signature]) -> Array:
    """How alike signatures look: 1 means that no fit can tell them apart. [S, S]."""
    shapes = np.stack([view.whiten(s.change.astype(np.float64)).ravel() for s in signatures])
    shapes /= np.maximum(np.linalg.norm(shapes, axis=1, keepdims=True), 1e-12)
    return shapes @ shapes.T
