"""Data types of a diagnosis: thresholds, candidates, fits that were tried, and results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np

from gsbridge.effects.registry import Applied, Registry
from gsbridge.geometry import Array

ROLES = ("fit", "select", "verify")
"""Parts of a case: effects are fitted to the first, chosen on the second and tested on the third."""

VERDICTS = ("no_discrepancy", "named", "ambiguous", "none_of_the_known", "not_attributable", "not_enough_excitation")

SILENT = ("no_discrepancy", "not_enough_excitation")
"""Verdicts that raise no alarm."""

ABSTAINING = ("none_of_the_known", "not_attributable")
"""Verdicts that say that something is missing without naming it."""

TRANSFERS = 0.5
"""Share of the gap on `verify` that a named effect must close."""

_SLIGHT = 1.1
"""Size of the gap on `verify`, in units of the noise, below which it is too small to refute a named effect."""

_EDGE = 1e-3
"""Distance from a bound, as a share of a parameter's range, within which the parameter counts as lying on the bound."""

_CLEAR = 3.0
"""Standard deviations by which an effect must differ from zero if it is one of several."""


@dataclass(frozen=True)
class Rules:
    """Thresholds of the verdict.

    Args:
        alarm: p-value below which a discrepancy counts.
        rivals: Number of candidates that are fitted before the search becomes stricter.
        sure: Probability of being the best that an explanation needs to be named.
        margin: Squared residual, in units of the noise, within which one explanation still counts as close to another.
        join: Gain in squared residual, in units of the noise, that a further effect must bring: the best of many candidates
            always gains a little by chance.
        earn: The same gain for a rival on `select`, to which neither was fitted, and for larger sets of effects.
        simple: Smallest such gain for the further parameters of an effect that contains a simpler one. Schwarz's term, the
            logarithm of the number of residuals, less Akaike's 2 applies if larger (Annals of Statistics 6, 1978).
        closure: Share of the gap that named effects must close if something remains.
        several: The same for several effects, on `select` or on `verify`: enough of them mimic a law that is missing.
        deviations: Standard deviations by which a gain on `select` must exceed chance, also under coloured noise.
        most: Largest number of effects in an explanation, outside an account.
        budget: Largest number of simulations of one diagnosis, without the bank and the account.
        larger: Factor by which what each of several effects explains must exceed what remains: an effect smaller than the
            model's own error is not named.
        least: Share of the gap that each of several named effects must close.
        worth: Share of the gap that an entry of an account must close.
        entries: Largest number of entries of an account.
        account: Largest number of simulations for an account.
    """

    alarm: float = 0.01
    rivals: int = 7
    sure: float = 0.95
    margin: float = 9.0
    join: float = 25.0
    earn: float = 4.0
    simple: float = 7.2
    closure: float = 0.9
    several: float = 0.95
    deviations: float = 3.0
    most: int = 3
    budget: int = 90
    larger: float = 3.0
    least: float = 0.01
    worth: float = 0.01
    entries: int = 16
    account: int = 1500


@dataclass(frozen=True, order=True)
class Candidate:
    """An effect that may be missing, and the joint that it would act on (empty if it acts on everything)."""

    registry: ClassVar[Registry[Any]]
    name: str
    joint: str = ""

    @property
    def effect(self) -> Any:
        """The effect's entry in the registry."""
        return self.registry.effect(self.name)

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return the parameter sets whose multiples are tried first."""
        found: tuple[dict[str, float], ...] = self.effect.directions()
        return found

    def applied(self, values: Mapping[str, float]) -> Applied:
        """Return the effect with these parameters."""
        return Applied(self.name, self.joint, dict(values))

    def from_vector(self, vector: Array) -> Applied:
        """Return the effect with the parameters of a vector, in the order in which the effect lists them. [P]."""
        return self.applied({p.name: float(x) for p, x in zip(self.effect.parameters, vector, strict=True)})

    def vector(self, values: Mapping[str, float]) -> Array:
        """Return parameters as a vector, in the order in which the effect lists them. [P]."""
        return np.array([values[p.name] for p in self.effect.parameters])

    def __str__(self) -> str:
        return f"{self.name}:{self.joint}" if self.joint else self.name


@dataclass(frozen=True)
class EffectFit:
    """Effects with fitted parameters.

    Args:
        who: The candidates.
        effects: Fitted effects with their parameters.
        chi2: Squared residual on the fitted records, in units of the noise; for the fit of a `Hypothesis`, on `fit` alone.
        converged: Whether the last step could gain nothing.
        deviations: Standard deviation of each parameter, from the curvature and from the change that another time step would
            make; coloured residuals are not allowed for. [P].
        correlation: Largest correlation of two parameters.
        rank: Number of parameters that the record determines independently.
        records: Number of records fitted together: 1 is `fit`, 2 is `fit` and `select`.
    """

    who: tuple[Candidate, ...]
    effects: tuple[Applied, ...]
    chi2: float
    converged: bool
    deviations: Array
    correlation: float
    rank: int
    records: int = 1

    @property
    def values(self) -> tuple[dict[str, float], ...]:
        """Parameters of each candidate."""
        return tuple(dict(effect.parameters) for effect in self.effects)

    @property
    def stopped(self) -> bool:
        """Whether an amplitude stopped at a bound: an effect that large is implausible and stands in for something else."""
        return any(
            parameter.amplitude
            and bound != 0.0
            and abs(values[parameter.name] - bound) <= _EDGE * (parameter.high - parameter.low)
            for candidate, values in zip(self.who, self.values, strict=True)
            for parameter in candidate.effect.parameters
            for bound in (parameter.low, parameter.high)
        )

    @property
    def blurred(self) -> bool:
        """Whether one of several effects does not clearly differ from zero, so that together they mimic something else."""
        if len(self.who) < 2:
            return False
        place = 0
        for candidate, values in zip(self.who, self.values, strict=True):
            clear = False
            for parameter in candidate.effect.parameters:
                clear |= parameter.amplitude and abs(values[parameter.name]) >= _CLEAR * self.deviations[place]
                place += 1
            if not clear:
                return True
        return False


@dataclass(frozen=True)
class Hypothesis:
    """A fit to the record `fit`, judged on `select`.

    `select` is held out, unless `fit` shows nothing of one of the effects; then both records were fitted.

    Args:
        fit: The fit, with its squared residual on `fit`.
        residual: Whitened residual on `select`. [T, C].
        first: Whitened residual on `fit`. [T, C].
        chi2: Squared residual on `select`.
        closure: Share of the gap on `select` that it closes.
    """

    fit: EffectFit
    residual: Array
    first: Array
    chi2: float
    closure: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its effects with their joints, sorted."""
        return tuple(sorted(str(candidate) for candidate in self.fit.who))

    @property
    def parameters(self) -> int:
        """Number of fitted parameters that the record determines."""
        return self.fit.rank

    @property
    def squares(self) -> float:
        """Squared residual of both records together."""
        return self.chi2 + self.fit.chi2

    @property
    def score(self) -> float:
        """`squares` with Akaike's penalty for what fitting gains by chance on the fitted records; the lower, the better."""
        return self.squares + (1.0 + self.fit.records) * self.parameters

    def holds(self, who: Candidate) -> bool:
        """Whether it contains an effect, or on the same joint a special case of that effect (some amplitudes at zero)."""
        return any(other == who or (who.name in other.effect.contains and who.joint == other.joint) for other in self.fit.who)

    def contains(self, other: Hypothesis) -> bool:
        """Whether another explanation is a special case of this one, according to the catalogue."""
        if set(other.fit.who) < set(self.fit.who):
            return True
        if len(self.fit.who) != len(other.fit.who) or set(self.fit.who) == set(other.fit.who):
            return False
        return all(
            any(b == a or (b.name in a.effect.contains and a.joint == b.joint) for b in other.fit.who) for a in self.fit.who
        )


H = TypeVar("H")
"""Type of a judged fit: `Hypothesis`, or a backend's own."""


@dataclass(frozen=True)
class Finding(Generic[H]):
    """Outcome of a diagnosis.

    Args:
        verdict: One of `VERDICTS`.
        best: The best hypothesis; None if nothing was fitted.
        rivals: All hypotheses, the best included and first, with the probability that each is the best.
        ambiguous: Names between which the data cannot decide.
        something_remains: Whether the best explanation leaves more than noise.
        p_value: p-value of the hypothesis that nothing is missing from the model.
        p_remaining: p-value of the hypothesis that nothing is missing beyond the best explanation.
        before: Root mean square residual on `select` without effects, in units of the noise.
        after: Root mean square residual on `select` with the best explanation, in units of the noise.
        runs: Number of simulations after the bank.
        unseen: Candidates that do not show in these records at any plausible size.
        coloured: Whether residuals exceed white noise without being motion.
        untold: Whether no two channels measure the same motion, so that motion and coloured noise cannot be told apart.
        lost: Candidates whose fit did not converge.
    """

    verdict: str
    best: H | None
    rivals: tuple[tuple[H, float], ...]
    ambiguous: tuple[str, ...]
    something_remains: bool
    p_value: float
    p_remaining: float
    before: float
    after: float
    runs: int
    unseen: tuple[str, ...] = field(default=())
    coloured: bool = False
    untold: bool = False
    lost: tuple[str, ...] = ()

    def refuted(self) -> Self:
        """Return the finding as it stands once `verify` contradicts it: the gap closed on `select`, but not on `verify`."""
        return replace(self, verdict="none_of_the_known", ambiguous=(), something_remains=True)


@dataclass(frozen=True)
class Verification:
    """The gap on `verify`, which is held out from all fits, without and with the best explanation.

    Args:
        before: Size of the gap without the effects, in the diagnosis' own unit (before it is scaled for the findings).
        after: Size of the gap with the effects, in the same unit.
        closure: Share of the gap above the noise that the effects close; negative if they make it worse.
        channels: `before` and `after` of each channel.
        accepted: Whether the amended model is no worse.
        p_remaining: p-value of the hypothesis that the effects leave only noise; None if it cannot be tested.
        mostly: Closure without the worst moments, for effects whose parts knock at moments that no law predicts.
        chance: Standard deviation of the square of `after` under noise alone; 0 if sizes are not in units of the noise.
    """

    before: float
    after: float
    closure: float
    channels: Mapping[str, tuple[float, float]]
    accepted: bool
    p_remaining: float | None = None
    mostly: float = -np.inf
    chance: float = 0.0

    @property
    def at_best(self) -> float:
        """Closure if two standard deviations of what is left are chance; a short record determines it no better."""
        if not self.chance or self.before <= 1.0:
            return self.closure
        left = max(self.after**2 - 1.0 - 2.0 * self.chance, 0.0)
        return max(self.closure, 1.0 - float(np.sqrt(left / (self.before**2 - 1.0))))

    def transfers(self, rules: Rules | None = None) -> bool:
        """Whether `verify` does not refute the effects.

        They must close at least `TRANSFERS` of a gap that stands out. Where noise can be tested for, they must also leave
        nothing but noise, or close nearly the whole gap.

        Args:
            rules: Thresholds; None for the defaults.
        """
        rules = rules or Rules()
        if self.p_remaining is None:
            return self.closure >= TRANSFERS
        if self.before >= _SLIGHT and self.at_best < TRANSFERS:
            return False
        return self.p_remaining >= rules.alarm or max(self.closure, self.mostly) >= rules.closure


NAMED, ONE_OF, LIKELY = "named", "one of", "likely, not proven"
"""Verdicts on an entry of an account, the surest first."""


def says_likely(findings: Mapping[str, Any]) -> bool:
    """Whether findings name nothing, but call the effect that explains most of the gap likely.

    Args:
        findings: Content of `findings.json`.
    """
    first = next(iter((findings.get("account") or {}).get("entries") or []), None)
    likely = first is not None and first["verdict"] == LIKELY and first["share"] >= TRANSFERS
    return likely and findings["verdict"] == "none_of_the_known"


@dataclass(frozen=True)
class AccountEntry:
    """One effect in an account.

    Args:
        candidate: The effect and its joint.
        effect: The effect with its parameters.
        deviations: Standard deviations of the parameters, model errors included, in the effect's order. [P].
        share: Share of the gap on `verify` that it closes beyond the entries before it; negative if it makes the gap worse.
        verdict: `NAMED`, `ONE_OF` or `LIKELY`.
        instead: Names of effects that could stand in its place.
        spans: 90 % intervals of the parameters, if they do not follow from `deviations`.
        figures: Old and new value of the model's own figures, by parameter, if it has such figures.
    """

    candidate: Candidate
    effect: Applied
    deviations: Array
    share: float
    verdict: str
    instead: tuple[str, ...]
    spans: Mapping[str, tuple[float, float]] | None = None
    figures: Mapping[str, tuple[float, float]] | None = None


@dataclass(frozen=True)
class GapAccount:
    """All effects that explain a part of a gap, and what remains.

    Args:
        entries: Effects in the order in which they explain the gap.
        explained: Share of the gap on `verify` that they close together.
        closes: The same share in the measure that names are judged by: of squares if gaps are root mean squares.
        channel, phase: Where most remains, the phase in words; empty if nothing stands out.
        left: Residual there, in the diagnosis' own unit.
    """

    entries: tuple[AccountEntry, ...]
    explained: float
    closes: float
    channel: str = ""
    phase: str = ""
    left: float = 0.0

    @property
    def effects(self) -> tuple[Applied, ...]:
        """Effects of all entries."""
        return tuple(entry.effect for entry in self.entries)
