"""Simpler methods to compare this package with, on the same records, signatures and noise."""

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
from gsbridge.gap.benchmark.campaign import OURS
from gsbridge.gap.benchmark.cma_search import BUDGET, search
from gsbridge.gap.benchmark.group_lasso import group_lasso
from gsbridge.gap.diagnosis.results import Candidate, Rules
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.candidates import candidates
from gsbridge.gap.joints.fit import fit
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals, share_noise
from gsbridge.gap.joints.screen import Screen
from gsbridge.geometry import Array

METHODS = (OURS, "largest_change", "training_bic", "cosine", "sparse", "group_lasso", "cma_es", "cma_es_tenfold")
"""Names of the methods: first this package's own, then the baselines.

`largest_change` fits all parameters at once and names the largest change; `training_bic` takes the best BIC on the fitted
record; `cosine` takes the signature with the largest cosine; `sparse` is sparse regression on signatures; `group_lasso` is
cross-validated group lasso on signatures; `cma_es` is CMA-ES on the likeliest candidates with as many simulations as a
diagnosis has, and `cma_es_tenfold` with ten times as many."""

SEARCHES = {"cma_es": 1, "cma_es_tenfold": 10}
"""Budget of each search, as a multiple of a diagnosis' simulations."""

ALARM = 0.01
"""p-value below which a baseline takes a residual for more than noise."""

FITTED = 7
"""Number of candidates that `training_bic` fits."""

_REFITTED = 6
"""Largest number of candidates kept by the lasso that are fitted again."""

Answer = tuple[list[Applied], float | None]
"""Named effects, and their lead over the runner-up in the method's own measure; None if there is no runner-up."""


def available(method: str) -> str | None:
    """Return the reason why a method cannot run here, or None."""
    if method in SEARCHES and importlib.util.find_spec("cma") is None:
        return "CMA-ES needs the package 'cma', which is not installed"
    return None


def run_baseline(
    method: str, system: MechanismModel, records: Mapping[str, Record], bank_folder: str | Path, seed: int
) -> dict[str, Any]:
    """Run a baseline, and return its findings in the form of `findings.json`.

    Args:
        method: One of `METHODS`, except the first.
        system: Model of the mechanism.
        records: Records by role; `fit` and `select` are used.
        bank_folder: Folder of banks of signatures.
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
    # The chi-squared test, which assumes white noise; none of these methods has a test of its own.
    loud = chi2_law.sf((residual**2).sum(), first.freedom) < ALARM
    found, lead = list[Applied](), None
    if loud:
        screen = Screen(first, bank)
        ways: dict[str, Callable[[], Answer]] = {
            "largest_change": lambda: _largest(screen, residual),
            "training_bic": lambda: _bic(first, screen, residual),
            "cosine": lambda: _cosine(screen, residual),
            "sparse": lambda: _sparse(screen, residual),
            "group_lasso": lambda: _grouped(first, second, screen, residual),
            **{name: functools.partial(_searched, first, second, screen, name, seed) for name in SEARCHES},
        }
        found, lead = ways[method]()
    sure = sureness(second.residual(), second.residual(found), second.freedom, lead) if found else {}
    runs = {"bank": bank.runs, "case": mechanism.runs - made - mechanism.shared}
    return answer(found, runs, time.perf_counter() - begin, sure)


def sureness(before: Array, after: Array, freedom: float, lead: float | None) -> dict[str, float]:
    """Measure in several ways how sure of its explanation a method without probabilities may be; larger is surer.

    No measure is best for all methods and sizes, so each method is compared by the measure that serves it best.

    Args:
        before: Residual without the explanation on a held-out record, in units of the noise. [...].
        after: Residual with the explanation, likewise. [...].
        freedom: Expected squared residual of noise alone.
        lead: Lead over the runner-up, see `Answer`.

    Returns:
        `gain`, the reduction of the squared residual; `share`, this reduction as a share of the excess over noise; `rest`, the
        remaining excess over noise, negated; and `lead`, if there is one.
    """
    plain, left = (float((values.astype(np.float64) ** 2).sum()) for values in (before, after))
    # At least two standard deviations of noise, since a share of a smaller excess is meaningless.
    excess = max(plain - freedom, 2.0 * float(np.sqrt(2.0 * freedom)))
    found = {"gain": plain - left, "share": (plain - left) / excess, "rest": freedom - left}
    return found if lead is None else {**found, "lead": lead}


def answer(
    found: Sequence[Applied], simulations: Mapping[str, int], seconds: float, sure: Mapping[str, float]
) -> dict[str, Any]:
    """Write a baseline's result in the form of `findings.json`.

    Args:
        found: Named effects with their sizes; empty if the baseline sees no discrepancy.
        simulations: Number of simulations, by purpose.
        seconds: Duration, s.
        sure: Result of `sureness`; empty if nothing is named.
    """
    return {
        "status": "pass",
        "sureness": dict(sure),
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
    """Return, for each candidate, the number of its best signature, and these signatures as columns. [T * C, S]."""
    gains, _ = screen.gains(screen.along(residual))
    rows = [max(group, key=lambda k: gains[k]) for group in screen.groups.values()]
    return rows, screen.shapes[rows].astype(np.float64).T


def _sized(screen: Screen, number: int, factor: float) -> Applied:
    signature = screen.signatures[number]
    return signature.candidate.applied(signature.candidate.effect.scaled(signature.values, factor))


def _typical(screen: Screen, number: int) -> float:
    """Return the largest ratio of a signature's amplitudes to their typical sizes."""
    signature = screen.signatures[number]
    ratios = [abs(signature.values[p.name]) / p.typical for p in signature.candidate.effect.parameters if p.amplitude]
    return max(ratios)


def _largest(screen: Screen, residual: Array) -> Answer:
    """Fit all candidates together by linear least squares, and name the largest one in units of typical sizes."""
    rows, columns = _columns(screen, residual)
    lengths = np.linalg.norm(columns, axis=0)
    factors = lsq_linear(columns / lengths, residual.ravel(), bounds=(0, np.inf), max_iter=50).x / lengths
    moved = np.array([factor * _typical(screen, row) for factor, row in zip(factors, rows, strict=True)])
    best = int(np.argmax(moved))
    found = [_sized(screen, rows[best], float(factors[best]))] if factors[best] > 0 else []
    return found, ahead(moved)


def _bic(view: JointResiduals, screen: Screen, residual: Array) -> Answer:
    """Name the single effect whose fit has the smallest BIC on the fitted record."""
    best, least = list[Applied](), float((residual**2).sum())
    tried = [-least]
    for match in screen.matches(residual)[:FITTED]:
        fitted = fit(view, (match.candidate,), (match.starts[0],), screen=screen)
        bic = fitted.chi2 + len(match.candidate.effect.parameters) * np.log(residual.size)
        tried.append(-bic)
        if bic < least:
            best, least = list(fitted.effects), bic
    return best, ahead(np.array(tried))


def _cosine(screen: Screen, residual: Array) -> Answer:
    """Name the effect whose signature has the largest cosine with the residual."""
    cosines = screen.along(residual) / np.sqrt(np.maximum(screen.sizes, 1e-300))
    number = int(np.argmax(cosines))
    best = [max(float(cosines[k]) for k in rows) for rows in screen.groups.values()]
    return [_sized(screen, number, float(cosines[number] / np.sqrt(screen.sizes[number])))], ahead(np.array(best))


def _sparse(screen: Screen, residual: Array) -> Answer:
    """Select signatures greedily (orthogonal matching pursuit) until BIC no longer improves."""
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
    return [_sized(screen, k, float(f)) for k, f in zip(chosen, factors, strict=True)], None


def _grouped(view: JointResiduals, other: JointResiduals, screen: Screen, residual: Array) -> Answer:
    """Name candidates that the cross-validated group lasso keeps.

    The few that explain most are fitted again, since a lasso shrinks sizes, and `needed` decides which of them stay.
    """
    owners = list(screen.groups)
    rows = [k for who in owners for k in screen.groups[who]]
    # Range of each candidate's columns.
    ends = np.cumsum([len(screen.groups[who]) for who in owners])
    groups = [range(end - len(screen.groups[who]), end) for who, end in zip(owners, ends, strict=True)]
    columns = screen.shapes[rows].astype(np.float64).T.reshape(*residual.shape, len(rows))
    factors = group_lasso(columns, groups, residual)
    kept: list[tuple[float, Candidate, Applied]] = []
    for who, group in zip(owners, groups, strict=True):
        explained = np.abs(factors[list(group)]) * np.sqrt(screen.sizes[[rows[k] for k in group]])
        first = int(np.argmax(explained))
        sized = _sized(screen, rows[group[first]], float(factors[group[first]]))
        # The lasso may give a negative factor to an effect of one sign, which `scaled` clips to zero.
        if any(sized.parameters[p.name] for p in who.effect.parameters if p.amplitude):
            kept.append((float(explained[first]), who, sized))
    kept = sorted(kept, key=lambda item: -item[0])[:_REFITTED]
    return needed(view, other, screen, [sized for *_, sized in kept]), None


def _searched(first: JointResiduals, second: JointResiduals, screen: Screen, method: str, seed: int) -> Answer:
    """Run a CMA-ES search with the method's budget, and name the effects of its result that `needed` keeps."""
    return needed(first, second, screen, search(first, screen, SEARCHES[method] * BUDGET, seed)), None


def ahead(values: Array) -> float | None:
    """Return by how much the largest of some values exceeds the next, or None for a single value. [K]."""
    return float(np.diff(np.sort(values)[-2:])[0]) if len(values) > 1 else None


def needed(first: JointResiduals, second: JointResiduals, screen: Screen, found: Sequence[Applied]) -> list[Applied]:
    """Fit a set of effects, and remove one after the other while that improves BIC on a held-out record.

    The remaining effects are fitted again each time, since an effect can take over what a similar one had explained. Removal
    goes on in any case until no more effects remain than a diagnosis may name.

    Args:
        first: Residuals on the record to which sizes are fitted.
        second: Residuals on the held-out record that decides which effects stay.
        screen: Signatures on the first record.
        found: The set, with start sizes.
    """
    price = float(np.log(second.residual().size))

    def fitted(effects: Sequence[Applied]) -> tuple[list[Applied], float]:
        if not effects:
            return [], float((second.residual() ** 2).sum())
        who = [type(screen.signatures[0].candidate)(effect.name, effect.joint) for effect in effects]
        new = list(fit(first, who, [dict(effect.parameters) for effect in effects], screen=screen).effects)
        cost = price * sum(len(candidate.effect.parameters) for candidate in who)
        return new, float((second.residual(new) ** 2).sum()) + cost

    kept, bic = fitted(found)
    while kept:
        without = [[*kept[:k], *kept[k + 1 :]] for k in range(len(kept))]
        weakest = min(without, key=lambda rest: float((second.residual(rest) ** 2).sum()))
        fewer, new = fitted(weakest)
        if new > bic and len(kept) <= Rules().most:
            break
        kept, bic = fewer, new
    return kept
