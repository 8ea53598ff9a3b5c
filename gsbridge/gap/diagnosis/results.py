"""What a diagnosis works with: thresholds, candidates, fits that were tried, and what was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np

from gsbridge.effects.registry import Applied, Registry
from gsbridge.geometry import Array

ROLES = ("fit", "select", "verify")
"""Parts of a case: effects are fitted to the first, chosen on the second and proven on the third."""

VERDICTS = ("no_discrepancy", "named", "ambiguous", "none_of_the_known", "not_attributable", "not_enough_excitation")

SILENT = ("no_discrepancy", "not_enough_excitation")
"""Verdicts that raise no alarm."""

ABSTAINING = ("none_of_the_known", "not_attributable")
"""Verdicts that something is missing, without a name for it."""

TRANSFERS = 0.5
"""Share of the gap that a name must close on `verify`."""

_SLIGHT = 1.1
"""Gap on `verify`, in units of the noise, below which it hardly shows there and cannot refute a name."""

_EDGE = 1e-3
"""Share of a parameter's range within which it lies on its bound."""

_CLEAR = 3.0
"""Standard deviations by which an effect beside others must differ from none."""


@dataclass(frozen=True)
class Rules:
    """Thresholds of the verdict.

    Args:
        alarm: p-value below which a discrepancy counts.
        rivals: Candidates that are fitted.
        sure: Probability of being best that a name needs.
        margin: Squared residual, in units of the noise, that a search looks beyond what was reached.
        join: The same by which one effect more must be better: the best of many candidates always wins a little by chance.
        earn: The same for a rival on the record that neither was fitted to, and for larger sets of effects.
        simple: The least of the same for further parameters of an effect that holds a simpler one; Schwarz's logarithm of the
            number of residuals, less Akaike's two, where that is more (Annals of Statistics 6, 1978).
        closure: Share of the gap that what is named must close where something remains.
        several: The same of several effects, on `select` or on `verify`: enough of them mimic a law that is missing.
        deviations: Standard deviations by which a mean gain on `select` must exceed chance, for coloured noise too.
        most: Effects that are looked for at once.
        draws: Number of draws of the block bootstrap.
        budget: Simulations of one diagnosis, apart from the bank and the account.
        larger: By how much more each of several must explain than what remains: what is smaller than the model's own error
            is not named.
        least: Share of the gap that each of several named effects must close.
        worth: Share of the gap that an entry of an account must close.
        entries: Most entries of an account.
        account: Simulations of an account.
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
    draws: int = 500
    budget: int = 90
    larger: float = 3.0
    least: float = 0.01
    worth: float = 0.01
    entries: int = 16
    account: int = 1500


@dataclass(frozen=True, order=True)
class Candidate:
    """An effect that may be missing, and the joint it would act on, empty where it acts on everything."""

    registry: ClassVar[Registry[Any]]
    name: str
    joint: str = ""

    @property
    def effect(self) -> Any:
        """The effect's entry in the registry."""
        return self.registry.effect(self.name)

    def directions(self) -> tuple[dict[str, float], ...]:
        """Parameter sets whose multiples are looked at first."""
        found: tuple[dict[str, float], ...] = self.effect.directions()
        return found

    def applied(self, values: Mapping[str, float]) -> Applied:
        """The effect with these parameters."""
        return Applied(self.name, self.joint, dict(values))

    def from_vector(self, vector: Array) -> Applied:
        """The effect with parameters in the order in which it lists them. [P]."""
        return self.applied({p.name: float(x) for p, x in zip(self.effect.parameters, vector, strict=True)})

    def vector(self, values: Mapping[str, float]) -> Array:
        """Parameters in the order in which the effect lists them. [P]."""
        return np.array([values[p.name] for p in self.effect.parameters])

    def __str__(self) -> str:
        return f"{self.name}:{self.joint}" if self.joint else self.name


@dataclass(frozen=True)
class EffectFit:
    """Effects with fitted parameters.

    Args:
        who: The candidates.
        effects: Fitted effects with their parameters.
        chi2: Squared residual on the fitted records, in units of the noise; of an explanation, on `fit` alone.
        converged: Whether the last step could win nothing.
        deviations: Standard deviation of each parameter from the curvature and from what another step of time would change,
            without allowance for coloured residuals. [P].
        correlation: Largest correlation of two parameters.
        rank: Parameters that show in the record, each in a way of its own.
        records: To how many of the first records of a case they were fitted together.
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
        """Whether an effect would have to be larger than makes sense, so that it was fitted to something else."""
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
        """Whether one of several effects may as well be absent, so that they together mimic something else."""
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
    """A fit to `fit` and how it does on `select`, which it has not seen, unless `fit` shows nothing of one of its effects.

    Args:
        fit: The fit, with its squared residual on `fit`.
        residual: Whitened, on `select`. [T, C].
        first: Whitened, on `fit`. [T, C].
        chi2: Square of the residual on `select`.
        closure: Share of the gap that it closes there.
    """

    fit: EffectFit
    residual: Array
    first: Array
    chi2: float
    closure: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its effects with their joints."""
        return tuple(sorted(str(candidate) for candidate in self.fit.who))

    @property
    def parameters(self) -> int:
        """Fitted numbers, as far as they show."""
        return self.fit.rank

    @property
    def squares(self) -> float:
        """Squared residuals on both records."""
        return self.chi2 + self.fit.chi2

    @property
    def score(self) -> float:
        """`squares` with Akaike's allowance for what fitting won on the fitted records by chance."""
        return self.squares + (1.0 + self.fit.records) * self.parameters

    def holds(self, who: Candidate) -> bool:
        """Whether it holds an effect, or one on the same joint that is the same with some amplitudes at zero."""
        return any(other == who or (who.name in other.effect.contains and who.joint == other.joint) for other in self.fit.who)

    def contains(self, other: Hypothesis) -> bool:
        """Whether another explanation is a special case of this one, by what the catalogue says."""
        if set(other.fit.who) < set(self.fit.who):
            return True
        if len(self.fit.who) != len(other.fit.who) or set(self.fit.who) == set(other.fit.who):
            return False
        return all(
            any(b == a or (b.name in a.effect.contains and a.joint == b.joint) for b in other.fit.who) for a in self.fit.who
        )


H = TypeVar("H")
"""Type of a fit that was judged: `Hypothesis`, or a backend's own."""


@dataclass(frozen=True)
class Finding(Generic[H]):
    """Outcome of a diagnosis.

    Args:
        verdict: One of `VERDICTS`.
        best: The best hypothesis; None where nothing was fitted.
        rivals: All hypotheses with the probability that each is best, the best first.
        ambiguous: Names among which the data cannot decide.
        something_remains: Whether the best explanation leaves more than noise.
        p_value: p-value of the hypothesis that nothing is missing from the model.
        p_remaining: p-value of the hypothesis that nothing is missing beyond the best explanation.
        before: Root mean square residual on `select` without effects, in units of the noise.
        after: Root mean square residual on `select` with the best explanation, in units of the noise.
        runs: Simulations after the bank.
        unseen: Candidates that do not show in these records at any sensible size.
        coloured: Whether residuals exceed white noise without being motion.
        untold: Whether no channels are related by motion, so that nothing could tell motion from coloured noise.
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
        """The finding once `verify` has contradicted it: it closed the gap where it was chosen, but not elsewhere."""
        return replace(self, verdict="none_of_the_known", ambiguous=(), something_remains=True)


@dataclass(frozen=True)
class Verification:
    """The gap on `verify`, which no fit has seen, without and with the best explanation.

    Args:
        before: Size of the gap without the effects, in the unit of the findings before scaling.
        after: Size of the gap with them.
        closure: Share of the gap above the noise that they close; negative if they make it worse.
        channels: Before and after of each channel.
        accepted: Whether the amended model is no worse.
        p_remaining: p-value of the hypothesis that they leave nothing but noise there; None where nothing tells.
        mostly: The closure at most times, where parts knock against each other at moments that no law tells.
        chance: Spread of the square of `after` that noise alone makes, where sizes are in units of the noise.
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
        """The closure, if noise happened to add to what is left by two of its spreads: a short record tells it no better."""
        if not self.chance or self.before <= 1.0:
            return self.closure
        left = max(self.after**2 - 1.0 - 2.0 * self.chance, 0.0)
        return max(self.closure, 1.0 - float(np.sqrt(left / (self.before**2 - 1.0))))

    def transfers(self, rules: Rules | None = None) -> bool:
        """Whether `verify` does not refute the effects.

        They close a good part of a gap that stands out, and leave noise alone where that can be told, or close nearly all.

        Args:
            rules: Thresholds.
        """
        rules = rules or Rules()
        if self.p_remaining is None:
            return self.closure >= TRANSFERS
        if self.before >= _SLIGHT and self.at_best < TRANSFERS:
            return False
        return self.p_remaining >= rules.alarm or max(self.closure, self.mostly) >= rules.closure


NAMED, ONE_OF, LIKELY = "named", "one of", "likely, not proven"
"""Words for how sure a line of an account is."""


def says_likely(findings: Mapping[str, Any]) -> bool:
    """Whether findings name nothing, but call what explains most of the gap likely.

    Args:
        findings: Content of `findings.json`.
    """
    first = next(iter((findings.get("account") or {}).get("entries") or []), None)
    likely = first is not None and first["verdict"] == LIKELY and first["share"] >= TRANSFERS
    return likely and findings["verdict"] == "none_of_the_known"


@dataclass(frozen=True)
class AccountEntry:
    """One line of an account.

    Args:
        candidate: The effect and its joint.
        effect: The effect with its parameters.
        deviations: Standard deviations of these, model errors included, in the order in which the effect lists them. [P].
        share: Share of the gap on `verify` that it closes after those before it; negative if it makes it worse.
        verdict: `NAMED`, `ONE_OF` or `LIKELY`.
        instead: What else could stand in its place.
        spans: 90 % intervals of the parameters, where deviations do not tell them.
        figures: What the model's own figures were and become with it, by parameter, where it has such.
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
    """All that explains a gap, and what remains.

    Args:
        entries: Effects in the order in which they explain the gap on `fit` and `select`.
        explained: Share of the gap on `verify` that they close together.
        closes: The same in the measure by which names are judged there: of squares, where gaps are root mean squares.
        channel, phase: Where most remains; empty where nothing stands out.
        left: Residual there, in units of the noise.
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
