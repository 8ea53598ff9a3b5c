"""Baselines for naming what changed between photos, on the same signatures and noise; `baselines` describes the methods."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import chi2 as chi2_law

from gsbridge.effects.registry import Applied
from gsbridge.gap.benchmark.baselines import ALARM, FITTED, Answer, ahead, answer, sureness
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.image.fit import fit
from gsbridge.gap.image.model import image_candidates
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.residuals import ImageResiduals, learn_noise
from gsbridge.gap.image.screen import Group, screen, signatures
from gsbridge.geometry import Array


def run_photo_baseline(method: str, pairs: Mapping[str, Pairs]) -> dict[str, Any]:
    """Run a baseline on photos, and return its findings in the form of `findings.json`.

    Args:
        method: `largest_change`, `training_bic`, `cosine` or `sparse`.
        pairs: Photos by role.
    """
    begin = time.perf_counter()
    first = ImageResiduals(pairs["fit"], learn_noise(list(pairs.values())))
    who = [one for one in image_candidates() if first.pairs.times is not None or not one.effect.timed]
    groups, residual = signatures(first, who), first.residual()
    found, lead = list[Applied](), None
    if chi2_law.sf((residual.astype(np.float64) ** 2).sum(), first.numbers) < ALARM:
        if method == "training_bic":
            found, lead = _bic(first, groups, residual)
        else:
            table = _SignatureTable(groups, residual)
            found, lead = {"largest_change": table.largest, "cosine": table.nearest, "sparse": table.few}[method]()
    sure: Mapping[str, float] = {}
    if found:
        second = ImageResiduals(pairs["select"], first.noise)
        sure = sureness(second.residual(), second.residual(found), second.numbers, lead)
    return answer(found, {"bank": 0, "case": first.expectation.pictures}, time.perf_counter() - begin, sure)


def _bic(view: ImageResiduals, groups: Sequence[Group], residual: Array) -> Answer:
    """Name the single effect whose fit has the smallest BIC on the fitted photos."""
    best, least = list[Applied](), float((residual.astype(np.float64) ** 2).sum())
    tried = [-least]
    for match in screen(groups, residual)[:FITTED]:
        fitted = fit(view, (match.candidate,), (match.start,))
        bic = fitted.chi2 + len(match.candidate.effect.parameters) * np.log(view.numbers)
        tried.append(-bic)
        if bic < least:
            best, least = list(fitted.effects), bic
    return best, ahead(np.array(tried))


class _SignatureTable:
    """Signatures as columns, and baselines that select among them; factors may be negative where an effect allows it."""

    def __init__(self, groups: Sequence[Group], residual: Array) -> None:
        rows = [
            (group.who, dict(group.values[k]), parameter.name, float(low), group.tables[k])
            for group in groups
            for k, (parameter, low) in enumerate(zip(group.who.effect.amplitudes, group.lows, strict=True))
        ]
        self.rows = [row for row in rows if row[4].any()]
        self.columns = np.stack([row[4].astype(np.float64) for row in self.rows], axis=1)
        self.lengths = np.linalg.norm(self.columns, axis=0)
        self.residual = residual.ravel().astype(np.float64)

    def _applied(self, number: int, factor: float) -> Applied:
        who, values, name, _, _ = self.rows[number]
        return who.applied(who.effect.clipped({**values, name: factor * values[name]}))

    def _typical(self, number: int) -> float:
        who, values, name, _, _ = self.rows[number]
        (parameter,) = (p for p in who.effect.parameters if p.name == name)
        return abs(values[name]) / parameter.typical

    def nearest(self) -> Answer:
        """Name the effect whose signature has the largest cosine with the residual."""
        along = self.columns.T @ self.residual
        both = np.array([row[3] < 0 for row in self.rows])
        cosines = np.where(both, np.abs(along), along) / self.lengths
        number = int(np.argmax(cosines))
        best: dict[Candidate, float] = {}
        for k, (who, *_) in enumerate(self.rows):
            best[who] = max(best.get(who, -np.inf), float(cosines[k]))
        return [self._applied(number, float(along[number] / self.lengths[number] ** 2))], ahead(np.array(list(best.values())))

    def largest(self) -> Answer:
        """Fit the best signature of every amplitude together, and name the largest one in units of typical sizes."""
        gains = (self.columns.T @ self.residual / self.lengths) ** 2
        kept: dict[tuple[Candidate, str], int] = {}
        for k, (who, _, name, _, _) in enumerate(self.rows):
            if (who, name) not in kept or gains[k] > gains[kept[who, name]]:
                kept[who, name] = k
        chosen = list(kept.values())
        lengths, lows = self.lengths[chosen], np.array([self.rows[k][3] for k in chosen])
        bounds = (np.minimum(lows, -1e-12) * lengths, np.inf)
        factors = lsq_linear(self.columns[:, chosen] / lengths, self.residual, bounds=bounds, max_iter=50).x / lengths
        moved = np.array([abs(factor) * self._typical(k) for factor, k in zip(factors, chosen, strict=True)])
        best = int(np.argmax(moved))
        return [self._applied(chosen[best], float(factors[best]))], ahead(moved)

    def few(self) -> Answer:
        """Select signatures greedily (orthogonal matching pursuit) until BIC no longer improves."""
        left, chosen, factors = self.residual, list[int](), np.zeros(0)
        owners: list[Candidate] = []
        while True:
            scores = np.abs(self.columns.T @ left) / self.lengths
            scores[[k for k, row in enumerate(self.rows) if row[0] in owners]] = -np.inf
            number = int(np.argmax(scores))
            tried = [*chosen, number]
            solved = np.linalg.lstsq(self.columns[:, tried], self.residual, rcond=None)[0]
            new = self.residual - self.columns[:, tried] @ solved
            lows = np.array([self.rows[k][3] for k in tried])
            gained = float(left @ left - new @ new)
            if not np.isfinite(scores[number]) or gained < np.log(self.residual.size) or (solved < lows).any():
                break
            chosen, factors, left = tried, solved, new
            owners.append(self.rows[number][0])
        return [self._applied(k, float(f)) for k, f in zip(chosen, factors, strict=True)], None
