"""What others do instead, on the same records, signatures and noise: to be beaten, or not."""

from __future__ import annotations

import functools
import importlib.util
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import chi2 as chi2_law

from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.benchmark.cma_search import BUDGET, search
from gsbridge.gap.benchmark.group_lasso import group_lasso
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.candidates import candidates
from gsbridge.gap.joints.fit import fit
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals, share_noise
from gsbridge.gap.joints.screen import Screen
from gsbridge.geometry import Array

METHODS = ("gsbridge", "largest_change", "training_bic", "cosine", "sparse", "group_lasso", "cma_es", "cma_es_tenfold")
"""This package's own, and: fit all parameters at once and name the largest change; the best training BIC; the signature of the
largest cosine; sparse regression on signatures; cross-validated group lasso on signatures; CMA-ES on the likeliest candidates
with the simulations of a diagnosis, and with ten times as many."""

SEARCHES = {"cma_es": 1, "cma_es_tenfold": 10}
"""Multiples of a diagnosis' simulations that the searches have."""

ALARM = 0.01
"""Probability below which a baseline takes a residual for more than noise."""

FITTED = 7
"""Candidates that the training BIC compares."""

_REFITTED = 6
"""Most candidates of a lasso that are fitted together; beyond that many their simulations would outgrow a diagnosis'."""


def available(method: str) -> str | None:
    """Reason why a method cannot run here, or None."""
    if method in SEARCHES and importlib.util.find_spec("cma") is None:
        return "CMA-ES needs the package 'cma', which is not installed"
    return None


def run_baseline(
    method: str, system: MechanismModel, records: Mapping[str, Record], bank_folder: str | Path, seed: int
) -> dict[str, Any]:
    """Findings of a baseline, in the form of `findings.json` as far as it has any.

    Args:
        method: One of `METHODS` but the first.
        system: Model of the mechanism.
        records: Records by role; `fit` and `select` are used.
        bank_folder: Where banks of signatures are kept.
        seed: Seed of methods that draw random numbers.

    Raises:
        InputError: The method is unknown or cannot run here.
    """
    if method not in METHODS[1:]:
        raise InputError("benchmark", f"there is no method '{method}'", f"Use one of {', '.join(METHODS)}")
    reason = available(method)
    if reason:
        raise InputError("benchmark", reason, "Install it, or leave this baseline out")
    begin, mechanism = time.perf_counter(), Mechanism(system)
    first, second = (JointResiduals.of(mechanism, records[role], folder=bank_folder) for role in ("fit", "select"))
    share_noise((first, second))
    before = mechanism.runs
    bank = signature_bank(first, candidates(first, others=(second,)), bank_folder)
    made = mechanism.runs - before
    residual = first.residual()
    # Theory's own test, which believes in white noise; none of these methods has another.
    loud = chi2_law.sf((residual**2).sum(), first.freedom) < ALARM
    found: Sequence[Applied] = ()
    if loud:
        screen = Screen(first, bank)
        ways: dict[str, Callable[[], list[Applied]]] = {
            "largest_change": lambda: _largest(screen, residual),
            "training_bic": lambda: _bic(first, screen, residual),
            "cosine": lambda: _cosine(screen, residual),
            "sparse": lambda: _sparse(screen, residual),
            "group_lasso": lambda: _grouped(first, second, screen, residual),
            **{name: functools.partial(_searched, first, second, screen, name, seed) for name in SEARCHES},
        }
        found = ways[method]()
    confidence = held_out(second.residual(), second.residual(found), second.freedom) if found else None
    runs = {"bank": bank.runs, "case": mechanism.runs - made - mechanism.shared}
    return answer(found, runs, time.perf_counter() - begin, confidence)


def held_out(before: Array, after: Array, freedom: float) -> float:
    """Share of a record's squared residual beyond noise that an explanation removes which was not fitted to it: how sure of
    it a method without a probability of its own may be.

    Args:
        before: Residual without the explanation, in units of the noise. Any shape.
        after: With it; the same shape.
        freedom: Squared residual that noise alone leaves.
    """
    plain, left = (float((values.astype(np.float64) ** 2).sum()) for values in (before, after))
    return float(np.clip(1.0 - max(left - freedom, 0.0) / max(plain - freedom, 1e-9), 0.0, 1.0))


def answer(
    found: Sequence[Applied], simulations: Mapping[str, int], seconds: float, confidence: float | None = None
) -> dict[str, Any]:
    """Findings of a baseline, in the form of `findings.json` as far as it has any.

    Args:
        found: Effects that it names, with their sizes; none where it sees no discrepancy.
        simulations: Simulations that were made, by purpose.
        seconds: Time that it took, s.
        confidence: How sure it is of them, from 0 to 1: by this it may abstain. None where it names nothing.
    """
    return {
        "status": "pass",
        "confidence": confidence,
        "verdict": "named" if found else "no_discrepancy",
        "effects": [_described(effect) for effect in found],
        "amended": [effect.record() for effect in found],
        "ambiguous": [],
        "something_remains": False,
        "rivals": [],
        "verify": None,
        "simulations": dict(simulations),
        "seconds": seconds,
    }


def _described(effect: Applied) -> dict[str, Any]:
    values = {name: {"value": value, "interval90": [value, value]} for name, value in effect.parameters.items()}
    return {"name": effect.name, "joint": effect.joint, "parameters": values}


def _columns(screen: Screen, residual: Array) -> tuple[list[int], Array]:
    """Number of the signature that explains most for each candidate, and these signatures side by side."""
    gains, _ = screen.gains(screen.along(residual))
    rows = [max(group, key=lambda k: gains[k]) for group in screen.groups.values()]
    return rows, screen.shapes[rows].astype(np.float64).T


def _sized(screen: Screen, number: int, factor: float) -> Applied:
    signature = screen.signatures[number]
    return signature.candidate.applied(signature.candidate.effect.scaled(signature.values, factor))


def _typical(screen: Screen, number: int) -> float:
    """Size of a signature's parameters in typical ones."""
    signature = screen.signatures[number]
    ratios = [abs(signature.values[p.name]) / p.typical for p in signature.candidate.effect.parameters if p.amplitude]
    return max(ratios)


def _largest(screen: Screen, residual: Array) -> list[Applied]:
    """All candidates together by linear least squares; the one that moved most in typical sizes."""
    rows, columns = _columns(screen, residual)
    lengths = np.linalg.norm(columns, axis=0)
    factors = lsq_linear(columns / lengths, residual.ravel(), bounds=(0, np.inf), max_iter=50).x / lengths
    best = max(range(len(rows)), key=lambda k: factors[k] * _typical(screen, rows[k]))
    return [_sized(screen, rows[best], float(factors[best]))] if factors[best] > 0 else []


def _bic(view: JointResiduals, screen: Screen, residual: Array) -> list[Applied]:
    """The fit with the smallest BIC on the record that it was fitted to."""
    best, least = [], float((residual**2).sum())
    for match in screen.matches(residual)[:FITTED]:
        fitted = fit(view, (match.candidate,), (match.starts[0],), screen=screen)
        bic = fitted.chi2 + len(match.candidate.effect.parameters) * np.log(residual.size)
        if bic < least:
            best, least = list(fitted.effects), bic
    return best


def _cosine(screen: Screen, residual: Array) -> list[Applied]:
    """The signature that is most nearly parallel to the residual."""
    cosines = screen.along(residual) / np.sqrt(np.maximum(screen.sizes, 1e-300))
    number = int(np.argmax(cosines))
    return [_sized(screen, number, float(cosines[number] / np.sqrt(screen.sizes[number])))]


def _sparse(screen: Screen, residual: Array) -> list[Applied]:
    """Signatures taken one by one by what they explain beside the others, until BIC is against it."""
    shapes, left, chosen = screen.shapes.astype(np.float64), residual.ravel(), list[int]()
    lengths = np.sqrt(np.maximum(screen.sizes, 1e-300))
    factors = np.zeros(0)
    owners: list[Candidate] = []
    while len(chosen) < len(screen.groups):
        scores = (shapes @ left) / lengths
        scores[[k for k, s in enumerate(screen.signatures) if s.candidate in owners]] = -np.inf
        number = int(np.argmax(scores))
        tried = [*chosen, number]
        solved = np.linalg.lstsq(shapes[tried].T, residual.ravel(), rcond=None)[0]
        new = residual.ravel() - solved @ shapes[tried]
        if float(left @ left - new @ new) < np.log(residual.size) or (solved <= 0).any():
            break
        chosen, factors, left = tried, np.asarray(solved), np.asarray(new)
        owners.append(screen.signatures[number].candidate)
    return [_sized(screen, k, float(f)) for k, f in zip(chosen, factors, strict=True)]


def _grouped(view: JointResiduals, other: JointResiduals, screen: Screen, residual: Array) -> list[Applied]:
    """Candidates that cross-validation keeps.

    The few that explain most are fitted anew, since a lasso's own sizes are too small, and those stay that the other record
    needs.
    """
    owners = list(screen.groups)
    rows = [k for who in owners for k in screen.groups[who]]
    # Number of each candidate's columns among those rows.
    ends = np.cumsum([len(screen.groups[who]) for who in owners])
    groups = [range(end - len(screen.groups[who]), end) for who, end in zip(owners, ends, strict=True)]
    columns = screen.shapes[rows].astype(np.float64).T.reshape(*residual.shape, len(rows))
    factors = group_lasso(columns, groups, residual)
    kept: list[tuple[float, Candidate, Applied]] = []
    for who, group in zip(owners, groups, strict=True):
        explained = np.abs(factors[list(group)]) * np.sqrt(screen.sizes[[rows[k] for k in group]])
        first = int(np.argmax(explained))
        sized = _sized(screen, rows[group[first]], float(factors[group[first]]))
        # A sum may want less than nothing of what has one sign.
        if any(sized.parameters[p.name] for p in who.effect.parameters if p.amplitude):
            kept.append((float(explained[first]), who, sized))
    kept = sorted(kept, key=lambda item: -item[0])[:_REFITTED]
    if not kept:
        return []
    refitted = fit(view, [who for _, who, _ in kept], [dict(sized.parameters) for *_, sized in kept], screen=screen)
    return needed(other, refitted.effects)


def _searched(first: JointResiduals, second: JointResiduals, screen: Screen, method: str, seed: int) -> list[Applied]:
    """What a search with its budget ends with."""
    return needed(second, search(first, screen, SEARCHES[method] * BUDGET, seed))


def needed(view: JointResiduals, found: Sequence[Applied]) -> list[Applied]:
    """Effects of a set without which a record fits worse than BIC charges for them, the others taken back one by one.

    Args:
        view: Record to which nothing was fitted.
        found: The set.
    """
    kept, squares = list(found), float((view.residual(found) ** 2).sum())
    price = float(np.log(view.residual().size))
    while kept:
        without = [float((view.residual([*kept[:k], *kept[k + 1 :]]) ** 2).sum()) for k in range(len(kept))]
        k = int(np.argmin(without))
        if without[k] - squares > price:
            break
        squares = without[k]
        kept.pop(k)
    return kept
