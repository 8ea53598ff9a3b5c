"""What others do instead, on the same records, signatures and noise: to be beaten, or not."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import chi2 as chi2_law

from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.bank import SignatureBank, signature_bank
from gsbridge.gap.joints.candidates import candidates
from gsbridge.gap.joints.fit import fit
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals, share_noise
from gsbridge.gap.joints.screen import Screen
from gsbridge.geometry import Array

METHODS = ("gsbridge", "largest_change", "training_bic", "cosine", "sparse", "cma_es")
"""This package's own, and: fit all parameters at once and name the largest change; the best training BIC; the signature of the
largest cosine; sparse regression on signatures; CMA-ES on all parameters."""

ALARM = 0.01
"""Probability below which a baseline takes a residual for more than noise."""

FITTED = 7
"""Candidates that the training BIC compares."""

_ROUNDS = 30
_SPREAD = 0.3
"""Generations and first step of CMA-ES, in typical sizes. Some 600 simulations of an arm, six times the most of a diagnosis."""


def available(method: str) -> str | None:
    """Reason why a method cannot run here, or None."""
    if method == "cma_es" and importlib.util.find_spec("cma") is None:
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
        rng = np.random.default_rng(seed)
        found = {
            "largest_change": lambda: _largest(screen, residual),
            "training_bic": lambda: _bic(first, screen, residual),
            "cosine": lambda: _cosine(screen, residual),
            "sparse": lambda: _sparse(screen, residual),
            "cma_es": lambda: _cma(first, bank, rng),
        }[method]()
    runs = {"bank": bank.runs, "case": mechanism.runs - made - mechanism.shared}
    return answer(found, runs, time.perf_counter() - begin)


def answer(found: Sequence[Applied], simulations: Mapping[str, int], seconds: float) -> dict[str, Any]:
    """Findings of a baseline, in the form of `findings.json` as far as it has any.

    Args:
        found: Effects that it names, with their sizes; none where it sees no discrepancy.
        simulations: Simulations that were made, by purpose.
        seconds: Time that it took, s.
    """
    return {
        "status": "pass",
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


def _cma(view: JointResiduals, bank: SignatureBank, rng: np.random.Generator) -> list[Applied]:
    """All amplitudes at once by CMA-ES; the one that moved most in typical sizes."""
    import cma

    who = list(dict.fromkeys(s.candidate for s in bank.signatures))
    starts = [next(s.values for s in bank.signatures if s.candidate == candidate) for candidate in who]

    def effects(factors: Array) -> list[Applied]:
        return [
            candidate.applied(candidate.effect.scaled(values, float(factor)))
            for candidate, values, factor in zip(who, starts, factors, strict=True)
        ]

    def cost(factors: Array) -> float:
        return float((view.residual(effects(factors)) ** 2).sum())

    options = {"maxiter": _ROUNDS, "verbose": -9, "seed": int(rng.integers(1, 2**31)), "bounds": [0, None]}
    best = np.asarray(cma.fmin2(cost, np.full(len(who), _SPREAD), _SPREAD, options)[0])
    sizes = [
        factor * max(abs(values[p.name]) / p.typical for p in candidate.effect.parameters if p.amplitude)
        for candidate, values, factor in zip(who, starts, best, strict=True)
    ]
    return [effects(best)[int(np.argmax(sizes))]]
