"""Screening before any fit: how much of a residual simulated signatures explain, alone and together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.gap.diagnosis.results import Candidate, EffectFit
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.signatures import Signature, SignatureBank
from gsbridge.geometry import Array

_STRETCH = (0.4, 60.0)
"""Range of factors by which a signature may be scaled: signatures just stand out from the noise, while a gap may be large."""

_PROJECTED = 1.2
"""A fit starts from a sum of signatures if that removes more than this many times the squared residual that the best single
one removes."""

_BESIDE = 9.0
"""Squared residual, in units of the noise, that a sum must remove beyond the best single signature to be a start at all: in a
large gap, even a signature with a neighbouring wave number explains most."""

_SMALL, _LARGE = 1e-2, 4.0
"""Range of the squared lengths, as shares of the residual's, of signatures that may take part in a sum of several. The lower
end is 0.05 times `_SMALL`."""

_MORE = 3
"""Number of candidates that are tried as one effect more beside a fit."""

SETS = 6
"""Most sets of effects that are tried for each number of effects in a set."""


@dataclass(frozen=True)
class SignatureMatch:
    """How well a candidate explains a residual before any fit.

    Args:
        candidate: The candidate.
        gain: Squared residual that the best of its signatures removes, in units of the noise.
        cosine: Cosine of the angle between residual and signature.
        starts: Parameters to start a fit from, best first.
        bound: Squared residual that all of its signatures together remove with any factors; no fit does much better.
    """

    candidate: Candidate
    gain: float
    cosine: float
    starts: tuple[dict[str, float], ...]
    bound: float = 0.0


@dataclass(frozen=True)
class Mixture:
    """Several candidates that explain a residual together, by adding signatures.

    Args:
        who: Candidates.
        starts: Start parameters of each candidate for a fit.
        gain: Squared residual that they remove together.
    """

    who: tuple[Candidate, ...]
    starts: tuple[dict[str, float], ...]
    gain: float


class Screen:
    """Signatures of a bank in units of the noise of one view.

    Args:
        view: Residuals of the record that the bank belongs to.
        bank: Signatures.

    Attributes:
        shapes: One row per signature. [S, T * C] float32.
        sizes: Squared lengths. [S].
    """

    def __init__(self, view: JointResiduals, bank: SignatureBank) -> None:
        rows = [view.whiten(s.change.astype(np.float64)).ravel().astype(np.float32) for s in bank.signatures]
        self.shapes = np.stack(rows) if rows else np.empty((0, view.sigma.size * len(view.record.time)), np.float32)
        self.sizes = (self.shapes.astype(np.float64) ** 2).sum(axis=1)
        self.signatures = bank.signatures
        self.owners = np.array([s.candidate for s in bank.signatures], dtype=object)
        self.groups: dict[Candidate, list[int]] = {}
        for number, signature in enumerate(bank.signatures):
            if self.sizes[number] > 0.0:
                self.groups.setdefault(signature.candidate, []).append(number)
        self._blocks = {who: self._split(who, rows) for who, rows in self.groups.items()}

    def _split(self, who: Candidate, rows: list[int]) -> list[tuple[list[int], Array, Array]]:
        """Group a candidate's signatures that may be added, and find the principal axes that each group spans.

        Returns:
            For each group: its signatures' numbers, its axes as sums of signatures, and the squared lengths of the axes.
        """
        forms = [p.name for p in who.effect.parameters if not p.amplitude and not who.effect.blends]
        parts: dict[tuple[float, ...], list[int]] = {}
        for k in rows:
            parts.setdefault(tuple(self.signatures[k].values[name] for name in forms), []).append(k)
        out = []
        for part in parts.values():
            scale = np.sqrt(self.sizes[part])
            values, vectors = np.linalg.eigh((self.shapes[part] @ self.shapes[part].T) / np.outer(scale, scale))
            keep = values > 1e-3 * values[-1]
            out.append((part, vectors[:, keep] / scale[:, None], values[keep]))
        return out

    def along(self, residual: Array) -> Array:
        """Compute the scalar product of a residual with every signature. [T, C] -> [S]."""
        return (self.shapes @ residual.ravel().astype(np.float32)).astype(np.float64)

    def gains(self, along: Array) -> tuple[Array, Array]:
        """Compute the squared residual that each signature removes, and its factor. [S] or [S, R] each."""
        sizes = np.maximum(self.sizes, 1e-300) if along.ndim == 1 else np.maximum(self.sizes, 1e-300)[:, None]
        factor = np.clip(along / sizes, *_STRETCH)
        return 2 * factor * along - factor**2 * sizes, factor

    def matches(self, residual: Array, starts: int = 3) -> list[SignatureMatch]:
        """Compare a residual with all signatures, and return the candidates with the largest gain first.

        Args:
            residual: Whitened residual. [T, C].
            starts: Largest number of starts from single signatures per candidate.
        """
        along = self.along(residual)
        gains, factors = self.gains(along)
        length, out = float(np.linalg.norm(residual)), []
        for who, rows in self.groups.items():
            order = sorted(rows, key=lambda k: -gains[k])
            first = order[0]
            values = [self._scaled(k, float(factors[k])) for k in order[:starts]]
            cosine = along[first] / max(np.sqrt(self.sizes[first]) * length, 1e-12)
            bound = self._bound(who, along)
            gain = max(float(gains[first]), 0.0)
            projected = self._projected(who, along) if bound > gain + _BESIDE else None
            if projected is not None:
                # Where several signatures together explain much more than one, the fit starts from their sum.
                values.insert(0 if bound > _PROJECTED * gain else 1, projected)
            out.append(SignatureMatch(who, float(gains[first]), float(cosine), tuple(values), bound))
        return sorted(out, key=lambda match: -match.gain)

    def _scaled(self, number: int, factor: float) -> dict[str, float]:
        """Return the parameters of a signature scaled by a factor; those of an effect with a threshold are kept."""
        effect = self.signatures[number].candidate.effect
        return effect.scaled(self.signatures[number].values, 1.0 if effect.threshold else factor)

    def _projected(self, who: Candidate, along: Array) -> dict[str, float] | None:
        """Compute parameters from a residual's projection onto a candidate's signatures; None where they do not add up.

        Amplitudes add up. A shape (the place of a mass) is the mean of the signatures' shapes, weighted by their amplitudes.
        """
        effect = who.effect
        if effect.threshold or len(effect.parameters) < 2:
            return None
        part, axes, values = max(
            self._blocks[who], key=lambda block: float(((along[block[0]] @ block[1]) ** 2 / block[2]).sum())
        )
        weights = axes @ ((along[part] @ axes) / values)
        table = {p.name: np.array([self.signatures[k].values[p.name] for k in part]) for p in effect.parameters}
        strength = sum(np.abs(table[p.name]) for p in effect.parameters if p.amplitude)
        share = weights * strength
        if abs(float(share.sum())) < 0.05 * float(np.abs(share).sum()):
            return None
        out = {}
        for p in effect.parameters:
            value = weights @ table[p.name] if p.amplitude else share @ table[p.name] / share.sum()
            out[p.name] = float(min(max(value, p.low), p.high))
        return out if any(out[p.name] != 0.0 for p in effect.parameters if p.amplitude) else None

    def _bound(self, who: Candidate, along: Array) -> float:
        """Compute the squared length of a residual's projection onto a candidate's signatures."""
        return max(float(((along[part] @ axes) ** 2 / values).sum()) for part, axes, values in self._blocks[who])

    def columns(self, who: Candidate, values: dict[str, float]) -> Array:
        """Estimate derivatives of the whitened replay by a candidate's amplitudes near `values` from its signatures.

        Derivatives by other parameters, and those that signatures cannot give, are not-a-number. [T * C, P].
        """
        parameters = who.effect.parameters
        out = np.full((self.shapes.shape[1], len(parameters)), np.nan)
        strengths = [k for k, p in enumerate(parameters) if p.amplitude]
        rows = self.groups.get(who, [])
        if not rows or who.effect.threshold:
            return out
        table = np.array([[self.signatures[k].values[p.name] for p in parameters] for k in rows])
        wanted = np.array([values[p.name] for p in parameters])
        forms = [k for k, p in enumerate(parameters) if not p.amplitude]
        spans = np.array([p.high - p.low for p in parameters])
        near = (np.abs(table[:, forms] - wanted[forms]) < 0.02 * spans[forms]).all(axis=1)
        if not near.any():
            return out
        ratio = np.linalg.norm(table[:, strengths], axis=1) / max(float(np.linalg.norm(wanted[strengths])), 1e-300)
        apart = np.abs(np.log(np.maximum(ratio, 1e-300))) + 1e3 * ~near
        if len(strengths) > 1:
            apart[(table[:, strengths] @ wanted[strengths]) < 0] += 1.0
        best = np.argsort(apart, kind="stable")[: max(2, len(strengths))] if len(strengths) > 1 else [int(np.argmin(apart))]
        best = [k for k in best if apart[k] < 1e3]
        solved = np.linalg.pinv(table[np.ix_(best, strengths)])
        if np.linalg.matrix_rank(table[np.ix_(best, strengths)], 1e-6) < len(strengths):
            return out
        out[:, strengths] = (solved @ self.shapes[[rows[k] for k in best]].astype(np.float64)).T
        return out

    def beside(self, fitted: EffectFit, residual: Array, count: int) -> list[Mixture]:
        """Add to the effects of a fit one of the candidates whose signatures explain most of its residual.

        Args:
            fitted: The fit.
            residual: Residual of the fit, in units of the noise. [T, C].
            count: Number of effects in each sum; nothing is returned unless the fit has one effect less.
        """
        if len(fitted.who) != count - 1:
            return []
        found = [match for match in self.matches(residual) if match.candidate not in fitted.who][:_MORE]
        return [Mixture((*fitted.who, m.candidate), (*fitted.values, m.starts[0]), m.gain) for m in found]

    def mixtures(self, residual: Array, count: int, keep: int) -> list[Mixture]:
        """Find the best sums of `count` signatures of different candidates, with factors in the range `_STRETCH`.

        Args:
            residual: Residual in units of the noise. [T, C].
            count: Number of signatures in a sum.
            keep: Largest number of sums to return.

        Returns:
            Sums, the largest gain first; none if fewer than `count` signatures have a size that fits the residual.
        """
        along, total = self.along(residual), float((residual.astype(np.float64) ** 2).sum())
        rows = np.flatnonzero((self.sizes > _SMALL * 0.05 * total) & (self.sizes < _LARGE * total))
        if len(rows) < count:
            return []
        names = {who: k for k, who in enumerate(self.groups)}
        owner = np.array([names[self.signatures[k].candidate] for k in rows])
        gram = (self.shapes[rows] @ self.shapes[rows].T).astype(np.float64)
        right = along[rows]
        sets: list[tuple[tuple[int, ...], float]] = [((k,), 0.0) for k in range(len(rows))]
        for _ in range(count - 1):
            sets = self._extend(sets, gram, right, owner, keep * 4)
        out, low, high = [], *_STRETCH
        for members, gain in sets[:keep]:
            chosen = list(members)
            factors = np.clip(np.linalg.lstsq(gram[np.ix_(chosen, chosen)], right[chosen], rcond=1e-9)[0], low, high)
            found = [self.signatures[rows[k]] for k in chosen]
            starts = tuple(self._scaled(int(rows[k]), float(f)) for k, f in zip(chosen, factors, strict=True))
            out.append(Mixture(tuple(s.candidate for s in found), starts, gain))
        return out

    @staticmethod
    def _extend(
        sets: Sequence[tuple[tuple[int, ...], float]], gram: Array, right: Array, owner: Array, keep: int
    ) -> list[tuple[tuple[int, ...], float]]:
        """Extend sets by one signature each; keep the best set of each group of candidates, largest gain first."""
        low, high = 0.5 * _STRETCH[0], 1.5 * _STRETCH[1]
        best: dict[tuple[int, ...], tuple[tuple[int, ...], float]] = {}
        diagonal = np.diag(gram)
        for members, _ in sets:
            chosen = list(members)
            inverse = np.linalg.pinv(gram[np.ix_(chosen, chosen)])
            base = inverse @ right[chosen]
            shared = inverse @ gram[chosen]
            left = diagonal - (gram[chosen] * shared).sum(axis=0)
            rest = right - base @ gram[chosen]
            factor = rest / np.maximum(left, 1e-9)
            others = base[:, None] - shared * factor
            fits = (left > 1e-3 * diagonal) & (factor > low) & (factor < high) & ((others > low) & (others < high)).all(axis=0)
            for number in chosen:
                fits &= owner != owner[number]
            gains = np.where(fits, right[chosen] @ base + rest * factor, -np.inf)
            for number in np.argsort(-gains)[:keep]:
                if not np.isfinite(gains[number]):
                    break
                key = tuple(sorted(int(owner[k]) for k in (*chosen, number)))
                if key not in best or gains[number] > best[key][1]:
                    best[key] = ((*members, int(number)), float(gains[number]))
        return sorted(best.values(), key=lambda item: -item[1])[:keep]


def cosines(view: JointResiduals, signatures: Sequence[Signature]) -> Array:
    """Compute the cosines between signatures; 1 or -1 means that no fit can tell two apart. [S, S]."""
    shapes = np.stack([view.whiten(s.change.astype(np.float64)).ravel() for s in signatures])
    shapes /= np.maximum(np.linalg.norm(shapes, axis=1, keepdims=True), 1e-12)
    return shapes @ shapes.T
