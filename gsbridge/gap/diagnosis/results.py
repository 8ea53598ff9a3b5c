"""What a diagnosis works with: thresholds, fits that were tried, and what was found."""

from __future__ import annotations

from dataclasses import dataclass, field

from gsbridge.gap.joints.fit import EffectFit
from gsbridge.geometry import Array

VERDICTS = ("no_discrepancy", "named", "ambiguous", "none_of_the_known", "not_enough_excitation")


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
        simple: The same for further parameters of an effect that holds a simpler one: Schwarz's logarithm of ten thousand
            samples instead of Akaike's two (Annals of Statistics 6, 1978).
        closure: Share of the gap that what is named must close where something remains.
        deviations: Of the mean, by which a gain on `select` must exceed chance, for coloured noise too.
        most: Effects that are looked for at once.
        draws: Of the block bootstrap.
        budget: Simulations of one diagnosis, apart from the bank and the account.
        larger: By how much more each of several must explain than what remains: what is smaller than the model's own error
            is not named.
        least: Share of the gap that a further entry of an account must close.
        entries: Of an account, at most.
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
    deviations: float = 3.0
    most: int = 3
    draws: int = 500
    budget: int = 140
    larger: float = 3.0
    least: float = 0.01
    entries: int = 12
    account: int = 400


@dataclass(frozen=True)
class Hypothesis:
    """A fit and how it does on the record that it has not seen.

    Args:
        fit: The fit.
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
        """Of its effects with their joints."""
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
        """The same with Akaike's allowance for what fitting won on the first by chance."""
        return self.squares + 2.0 * self.parameters

    def contains(self, other: Hypothesis) -> bool:
        """Whether another explanation is a special case of this one, by what the catalogue says."""
        if set(other.fit.who) < set(self.fit.who):
            return True
        if len(self.fit.who) != len(other.fit.who) or set(self.fit.who) == set(other.fit.who):
            return False
        return all(
            any(b == a or (b.name in a.effect.contains and a.joint == b.joint) for b in other.fit.who) for a in self.fit.who
        )


@dataclass(frozen=True)
class Finding:
    """What was found.

    Args:
        verdict: One of `VERDICTS`.
        best: The best trial; None where nothing was fitted.
        rivals: All trials with the probability that each is best, the best first.
        ambiguous: Names among which the data cannot decide.
        something_remains: Whether the best explanation leaves more than noise.
        p_value: Of the hypothesis that nothing is missing.
        p_remaining: Of the hypothesis that nothing is missing beyond the best explanation.
        before: Root mean square residual on `select` without effects, in units of the noise.
        after: With the best explanation.
        runs: Simulations after the bank.
        unseen: Candidates that do not show in these records at any sensible size.
        coloured: Whether residuals exceed white noise without being motion.
        untold: Whether no channels are related by motion, so that nothing could tell motion from coloured noise.
        lost: Candidates whose fit did not converge.
    """

    verdict: str
    best: Hypothesis | None
    rivals: tuple[tuple[Hypothesis, float], ...]
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
