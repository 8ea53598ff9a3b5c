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
"""Most candidates of a lasso that are fitted together."""

Answer = tuple[list[Applied], float | None]
"""Effects, and by how much they lead what else the method looked at, in its own measure; None where it has no runner-up."""


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
    """How sure of an explanation a method without a probability of its own may be, by several measures; larger is surer.

    None of them is right for all methods and sizes, so that each method is compared by the one that serves it best.

    Args:
        before: Residual without the explanation on a record that it was not fitted to, in units of the noise. [...].
        after: The same with it. [...].
        freedom: Squared residual that noise alone leaves.
        lead: See `Answer`.

    Returns:
        `gain`, the squared residual that it removes; `share`, as a share of what exceeds noise; `rest`, the squared residual
        that it leaves beyond noise, with a minus; and `lead`, where there is one.
    """
    plain, left = (float((values.astype(np.float64) ** 2).sum()) for values in (before, after))
    # Two standard deviations of noise: below that an excess is none, and a share of it says nothing.
    excess = max(plain - freedom, 2.0 * float(np.sqrt(2.0 * freedom)))
    found = {"gain": plain - left, "share": (plain - left) / excess, "rest": freedom - left}
    return found if lead is None else {**found, "lead": lead}


def answer(
    found: Sequence[Applied], simulations: Mapping[str, int], seconds: float, sure: Mapping[str, float]
) -> dict[str, Any]:
    """Findings of a baseline, in the form of `findings.json` as far as it has any.

    Args:
        found: Effects that it names, with their sizes; none where it sees no discrepancy.
        simulations: Simulations that were made, by purpose.
        seconds: Time that it took, s.
        sure: How sure it is of them; see `sureness`. Empty where it names nothing.
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


def _largest(screen: Screen, residual: Array) -> Answer:
    """All candidates together by linear least squares; the one that moved most in typical sizes."""
    rows, columns = _columns(screen, residual)
    lengths = np.linalg.norm(columns, axis=0)
    factors = lsq_linear(columns / lengths, residual.ravel(), bounds=(0, np.inf), max_iter=50).x / lengths
    moved = np.array([factor * _typical(screen, row) for factor, row in zip(factors, rows, strict=True)])
    best = int(np.argmax(moved))
    found = [_sized(screen, rows[best], float(factors[best]))] if factors[best] > 0 else []
    return found, ahead(moved)


def _bic(view: JointResiduals, screen: Screen, residual: Array) -> Answer:
    """The fit with the smallest BIC on the record that it was fitted to."""
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
    """The signature that is most nearly parallel to the residual."""
    cosines = screen.along(residual) / np.sqrt(np.maximum(screen.sizes, 1e-300))
    number = int(np.argmax(cosines))
    best = [max(float(cosines[k]) for k in rows) for rows in screen.groups.values()]
    return [_sized(screen, number, float(cosines[number] / np.sqrt(screen.sizes[number])))], ahead(np.array(best))


def _sparse(screen: Screen, residual: Array) -> Answer:
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
    return [_sized(screen, k, float(f)) for k, f in zip(chosen, factors, strict=True)], None


def _grouped(view: JointResiduals, other: JointResiduals, screen: Screen, residual: Array) -> Answer:
    """Candidates that cross-validation keeps.

    The few that explain most are fitted anew, since a lasso's own sizes are too small, and `needed` decides which stay.
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
    return needed(view, other, screen, [sized for *_, sized in kept]), None


def _searched(first: JointResiduals, second: JointResiduals, screen: Screen, method: str, seed: int) -> Answer:
    """What is needed of that with which a search with its budget ends."""
    return needed(first, second, screen, search(first, screen, SEARCHES[method] * BUDGET, seed)), None


def ahead(values: Array) -> float | None:
    """By how much the largest of some values exceeds the next. [K]; None for a single one."""
    return float(np.diff(np.sort(values)[-2:])[0]) if len(values) > 1 else None


def needed(first: JointResiduals, second: JointResiduals, screen: Screen, found: Sequence[Applied]) -> list[Applied]:
    """Fit a set of effects, and take back one after the other as long as BIC on a record that it was not fitted to allows.

    What stays is fitted anew each time: of effects that look alike one takes over what the other had explained. More than a
    diagnosis may name never stay.

    Args:
        first: Record that sizes are fitted to.
        second: Record that decides which stay.
        screen: Signatures on the first.
        found: The set, with sizes to start from.
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
