"""Extension of an explanation beyond what is certain: effects are added while each explains enough of the gap for an entry.

Named effects are fitted to one record and judged on another. The account is judged on the third record, so that it can be
fitted to both others: one motion alone seldom separates friction, weight and lag, and divides the gap among them by chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import norm

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.closure import beyond_noise
from gsbridge.gap.diagnosis.results import Candidate, EffectFit, Finding, Hypothesis, Rules
from gsbridge.gap.diagnosis.verdict import told_apart, transfer
from gsbridge.gap.joints.candidates import thresholds
from gsbridge.gap.joints.fit import derivatives, fit, settled
from gsbridge.gap.joints.limits import levels, nothing_fitted
from gsbridge.gap.joints.looks import Look, key_of, plainest_first
from gsbridge.gap.joints.pooled import PooledResiduals, spread_of
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import Screen
from gsbridge.gap.joints.surfaces import heights_between, is_surface, supports
from gsbridge.geometry import Array

_FRESH = 8
"""Candidates that are simulated anew beside each explanation, before one of them is fitted."""

_FITTED = 3
"""Largest number of candidate effects that are fitted in one round, beside a surface that the arm leans on."""

_DRY, _AGAIN = 3, 2
"""Number of rounds in a row without a further effect after which the search ends, and number of effects that must be added
before one that failed is tried again."""

_BESIDE = 4
"""Number of effects at which the first one, which was chosen with no other beside it, is compared with others again."""

_EACH = 0.25
"""Factor on `Rules.worth` for the share of the gap that an effect must close on each single record."""

_LARGE, _HALF_SURE = 0.05, 0.5
"""Share of the whole gap from which on an effect may be less sure on one record, and the factor on `Rules.deviations` there:
a motion that hardly excites an effect, such as the inertia of a rotor at a slow pace, does not refute it."""

_IDLE = 0.01
"""Squared change of a record, in shares of the noise's square, below which an effect does nothing there."""

_HALVINGS = 2
"""How often, in each round, the distance between tried heights of a surface is halved."""

_STRAINED = 0.9
"""Share of the largest sensible size of an effect, beyond which it is not taken into an account."""

_AS_GOOD = 0.9
"""Share of an entry's reduction of the residual's length that another effect must reach in its place to be listed as an
alternative."""

_ALTERNATIVES, _TRIED = 6, 2
"""Largest number of alternatives that an entry of the account lists, and how many of them are fitted in its place."""


@dataclass
class Widening:
    """The search for all effects that explain a part of a gap.

    Args:
        first: Residuals on the record `fit`.
        second: Residuals on the record `select`.
        who: Candidates.
        screen: Signatures on `fit`.
        rules: Thresholds.
        floors: Chi squared that a perfect model would leave on each of the two.
        remains: Whether a hypothesis leaves more than noise.
    """

    first: JointResiduals
    second: JointResiduals
    who: Sequence[Candidate]
    screen: Screen
    rules: Rules
    floors: tuple[float, float]
    remains: Callable[[Hypothesis], bool]
    _looks: dict[tuple[Candidate, tuple[float, ...]], Look] = field(default_factory=dict)
    _sizes: dict[Candidate, list[dict[str, float]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.both = PooledResiduals((self.first, self.second))
        self._end = self.both.mechanism.runs + self.rules.account
        self._nothing = self._judged(nothing_fitted(self.both.residual()))

    def widen(self, finding: Finding) -> Hypothesis | None:
        """Grow an explanation with all effects that help, from what was named or from nothing.

        Args:
            finding: Finding of `JointIdentification.run`.

        Returns:
            The explanation with all effects that explain enough; None where nothing could be fitted.
        """
        if finding.best is None:
            return None
        said = finding.verdict in ("named", "ambiguous")
        if said and (finding.best.fit.stopped or not self.remains(finding.best)):
            return self._as_told(finding.best, finding)
        nothing = self._nothing
        best = finding.best if said else nothing
        best = self._grown(best)
        if best is not nothing and best is not finding.best:
            better = self._exchanged(best, best.fit.who)
            best = best if better is best else self._grown(better)
        if best is nothing or best is finding.best:
            return self._as_told(finding.best, finding)
        found = settled(self.both, best.fit, self._end)
        best = best if found is best.fit else self._judged(found)
        return replace(best, fit=replace(best.fit, deviations=_spread(self.both, best.fit)))

    def _grown(self, best: Hypothesis) -> Hypothesis:
        """Add effects to an explanation, one at a time, while they earn their place."""
        failed: dict[Candidate, int] = {}
        dry, first = 0, best.fit.who == ()
        while dry < _DRY and len(best.fit.who) < self.rules.entries and (not best.fit.who or self.remains(best)):
            grown = self._wider(best, failed)
            dry = dry + 1 if grown is best else 0
            best = grown
            if first and len(best.fit.who) == _BESIDE:
                # The first effect was chosen alone: correct a wrong choice before more effects are fitted to what it leaves.
                best, first = self._exchanged(best, best.fit.who[:1]), False
        return best

    def _exchanged(self, best: Hypothesis, taken: Sequence[Candidate]) -> Hypothesis:
        """Replace effects that were chosen early by others with which the whole explains more.

        Without other effects, a filter of the commands and a damped controller look alike; beside friction they do not.

        Args:
            best: The explanation.
            taken: Effects that may be replaced.
        """
        allowed = self.rules.join * max(1.0, self._squares(best.fit) / sum(self.floors))
        for who in taken:
            k = best.fit.who.index(who)
            others, values = [c for c in best.fit.who if c != who], [v for j, v in enumerate(best.fit.values) if j != k]
            for look in self._alike(best, k)[:_TRIED]:
                if self.both.mechanism.runs >= self._end or len(look.values) > len(who.effect.parameters):
                    break
                trial = fit(self.both, (*others, look.candidate), (*values, look.values), limit=self._end)
                sound = not trial.stopped and not strained(trial)
                if sound and self._squares(trial) < self._squares(best.fit) - allowed:
                    best = self._judged(trial)
                    break
        return best

    def _squares(self, fitted: EffectFit) -> float:
        """Compute the squared residual that a fit leaves on both records."""
        return float((self.both.residual(fitted.effects) ** 2).sum())

    def _as_told(self, best: Hypothesis, finding: Finding) -> Hypothesis:
        """Return the best explanation of a finding, its deviations scaled as in the findings, or wider where the model errs."""
        deviations = max(1.0, finding.after) * best.fit.deviations
        if finding.something_remains and best.fit.converged:
            deviations = np.maximum(deviations, _spread(PooledResiduals(self.both.views[: best.fit.records]), best.fit))
        return replace(best, fit=replace(best.fit, deviations=deviations))

    def instead(self, whole: Hypothesis, k: int, third: JointResiduals | None = None) -> tuple[str, ...]:
        """List what else could stand in the place of one effect of an explanation, the likeliest first.

        Args:
            whole: The explanation.
            k: Number of the effect.
            third: Residuals on the record `verify`. With it, each alternative is fitted in the effect's place and judged on all
                records, and those with clearly larger residuals are left out.
        """
        alike = self._alike(whole, k)[:_ALTERNATIVES]
        if third is not None and alike:
            known = [view.residual(whole.fit.effects) for view in (*self.both.views, third)]
            alike = [look for look in alike if not self._worse(look, whole, k, known, third)]
        return tuple(str(look.candidate) for look in alike)

    def _worse(self, look: Look, whole: Hypothesis, k: int, known: Sequence[Array], third: JointResiduals) -> bool:
        """Tell whether an explanation clearly errs more, on all records, with another effect in the place of effect `k`."""
        others = [candidate for j, candidate in enumerate(whole.fit.who) if j != k]
        values = [found for j, found in enumerate(whole.fit.values) if j != k]
        trial = fit(self.both, (*others, look.candidate), (*values, look.values), limit=self._end)
        left = [view.residual(trial.effects) for view in (*self.both.views, third)]
        return trial.converged and told_apart(known, left) > norm.isf(1.0 - self.rules.sure)

    def _alike(self, whole: Hypothesis, k: int) -> list[Look]:
        """List effects that explain as much in the place of effect `k`, by one simulation each, the likeliest first."""
        others = tuple(effect for j, effect in enumerate(whole.fit.effects) if j != k)
        row = self.both.residual(others)
        alone = float(np.linalg.norm(row))
        explained = alone - float(np.linalg.norm(self.both.residual(whole.fit.effects)))
        who = whole.fit.who[k]
        first = self.both.parts(row)[0]
        matches = sorted(self.screen.matches(first), key=lambda match: -match.bound)
        out: list[tuple[float, str, Look]] = []
        # A candidate that contains the effect as a special case explains as much by construction and is no alternative.
        rivals = [
            match
            for match in matches
            if match.candidate not in whole.fit.who
            and not (match.candidate.joint == who.joint and who.name in match.candidate.effect.contains)
        ]
        for match in rivals[:_FRESH]:
            changed = self.both.residual((*others, match.candidate.applied(match.starts[0])))
            look = Look(match.candidate, match.starts[0], row - changed)
            factor, gain = look.guess(row)
            if alone - np.sqrt(max(alone**2 - gain, 0.0)) >= _AS_GOOD * explained:
                out.append((-gain, str(match.candidate), Look(match.candidate, look.scaled(factor), look.change)))
        return [look for _, _, look in sorted(out, key=lambda item: item[:2])]

    def _wider(self, best: Hypothesis, failed: dict[Candidate, int]) -> Hypothesis:
        """Add the effect that helps most; return the same explanation if none earns its place."""
        self.both = self.both.robust(best.fit.effects)
        known = derivatives(self.both, best.fit)
        looks = self._promising(best, failed, np.linalg.qr(known)[0])
        surface = self._leaning(best, failed)
        if surface is not None:
            looks = [surface, *(look for look in looks if look.candidate != surface.candidate)]
        for look in looks:
            if self.both.mechanism.runs >= self._end:
                break
            who, start = (*best.fit.who, look.candidate), (*best.fit.values, look.values)
            trial = self._judged(fit(self.both, who, start, limit=self._end, known=known))
            if self._earns(trial, best):
                return trial
            failed[look.candidate] = len(best.fit.who)
        return best

    def _judged(self, fitted: EffectFit) -> Hypothesis:
        residual = self.second.residual(fitted.effects)
        return Hypothesis(fitted, residual, self.first.residual(fitted.effects), float((residual**2).sum()), 0.0)

    def _lengths(self, trial: Hypothesis) -> list[float]:
        """Compute the residual's length beyond the noise: of both records together, then of each."""
        squares = [float((part**2).sum()) for part in self.both.parts(self.both.residual(trial.fit.effects))]
        return [beyond_noise(a, b) for a, b in ((sum(squares), sum(self.floors)), *zip(squares, self.floors, strict=True))]

    def _promising(self, best: Hypothesis, failed: dict[Candidate, int], basis: Array) -> list[Look]:
        """List candidates that help on both records at their start parameters, the most helpful first.

        Since all effects are refitted together, a candidate is judged only by the part of its change that the present effects
        cannot make with other parameters: a stiffer controller shows only once friction has grown with it.
        """
        row = self.both.residual(best.fit.effects)
        for candidate, values in self._starts(best):
            if key_of(candidate, values) not in self._looks and self.both.mechanism.runs < self._end:
                self._look(best, candidate, values)
        left_out = {*best.fit.who, *_out_of_turn(best, failed)}
        for who in (who for who in self.who if is_surface(who) and who not in left_out):
            for _ in range(_HALVINGS):
                seen = [self._weighed(look) for (candidate, _), look in self._looks.items() if candidate == who]
                for values in heights_between(seen, row):
                    if self.both.mechanism.runs < self._end:
                        self._look(best, who, values)
        stale = [self._weighed(look) for (who, _), look in self._looks.items() if who not in left_out]
        ranked = dict[Candidate, Look]()
        for look in sorted((look.beside(basis) for look in stale), key=lambda look: -look.guess(row)[1]):
            ranked.setdefault(look.candidate, look)
        found: list[tuple[float, Look]] = []
        for look in list(ranked.values())[:_FRESH]:
            if self.both.mechanism.runs >= self._end:
                break
            fresh = self._look(best, look.candidate, look.scaled(look.guess(row)[0])).beside(basis)
            factor, gain = fresh.guess(row)
            parts = zip(self.both.parts(fresh.change), self.both.parts(row), strict=True)
            gains = [float((left**2).sum() - ((left - factor * part) ** 2).sum()) for part, left in parts]
            if gain > 0.0 and min(gains) > -0.1 * gain:
                found.append((gain, Look(fresh.candidate, fresh.scaled(factor), fresh.change)))
        found.sort(key=lambda item: -item[0])
        return [look for _, look in plainest_first(found)][:_FITTED]

    def _leaning(self, best: Hypothesis, failed: dict[Candidate, int]) -> Look | None:
        """Find the surface that explains most of the residual at the moments when the arm leans on it; None if none does.

        Other effects are judged over whole records, with less weight on moments that nothing explains yet. An arm leans on a
        surface in a few such moments only, so that here they count in full.

        Args:
            best: The explanation so far.
            failed: Candidates whose fit failed, with the number of effects that stood beside them then.
        """
        row = self._plain(best.fit.effects)
        left_out = {*best.fit.who, *_out_of_turn(best, failed)}
        surfaces = [who for who in self.who if is_surface(who) and who not in left_out]
        found: list[tuple[float, Look]] = []
        for look in (look for (who, _), look in self._looks.items() if who in surfaces):
            if self._supports(row, look.change):
                found.append((float(row @ row - (row - look.change) @ (row - look.change)), look))
        return max(found, key=lambda item: item[0])[1] if found else None

    def _supports(self, row: Array, change: Array) -> bool:
        """Tell whether a surface explains most of the residual where the arm leans on it, and enough of the whole gap."""
        gap = float(np.linalg.norm(self._plain(())))
        return supports(self.both.parts(row), self.both.parts(change), _EACH * self.rules.worth * gap)

    def _plain(self, effects: Sequence[Applied]) -> Array:
        """Compute the residual of both records with equal weights for all moments. [sum of T C]."""
        return replace(self.both, weights=None).residual(effects)

    def _starts(self, best: Hypothesis) -> list[tuple[Candidate, dict[str, float]]]:
        """List candidates with the parameters at which they are simulated beside an explanation.

        The change by an effect with a threshold tells nothing of other thresholds. A surface is therefore tried at every
        height, since `fit` alone may never come near it. On the joints that err most on either record, other such effects are
        tried at all sizes, limits at shares of the largest values on the records.
        """
        surfaces = [who for who in self.who if is_surface(who)]
        out = [(m.candidate, m.starts[0]) for m in self.screen.matches(best.first) if m.candidate not in surfaces]
        # A limit may show on one record only, so that both are asked.
        erring = [thresholds(self.who, self.first, best.first), thresholds(self.who, self.second, best.residual)]
        for who in dict.fromkeys((*surfaces, *erring[0], *erring[1])):
            if who not in self._sizes:
                sizes = [who.effect.scaled(way, size) for way in who.directions() for size in who.effect.sizes]
                self._sizes[who] = levels(self.both.views, best.fit.effects, who) if who.effect.cuts else sizes
            out += [(who, values) for values in self._sizes[who]]
        return out

    def _look(self, best: Hypothesis, candidate: Candidate, values: dict[str, float]) -> Look:
        """Simulate a candidate beside an explanation.

        Its change is stored without the weights of the moments, since these differ from round to round.
        """
        effects = best.fit.effects
        change = self._plain(effects) - self._plain((*effects, candidate.applied(values)))
        look = self._looks[key_of(candidate, values)] = Look(candidate, values, change.astype(np.float32))
        return self._weighed(look)

    def _weighed(self, look: Look) -> Look:
        """Apply the present weights of the moments to a candidate's change."""
        return look if self.both.weights is None else replace(look, change=self.both.weights * look.change)

    def _earns(self, trial: Hypothesis, best: Hypothesis) -> bool:
        """Tell whether one effect more explains enough of the gap, on each record, and by more than chance.

        What shows on one record alone may be a disturbance. An effect with a threshold, however, may not act on the other.
        """
        if trial.fit.stopped or strained(trial.fit):
            return False
        gaps, before, after = (self._lengths(fitted) for fitted in (self._nothing, best, trial))
        shares = [(a - b) / max(gap, 1e-9) for a, b, gap in zip(before, after, gaps, strict=True)]
        row = self._plain(best.fit.effects)
        leans = is_surface(trial.fit.who[-1]) and self._supports(row, row - self._plain(trial.fit.effects))
        if shares[0] < self.rules.worth and not leans:
            return False
        helps = [share >= _EACH * self.rules.worth for share in shares[1:]]
        pairs = ((best.first, trial.first), (best.residual, trial.residual))
        sure = [transfer(*pair, remembered=False) / self.rules.deviations for pair in pairs]
        least = _HALF_SURE if shares[0] >= _LARGE and max(sure) > 1.0 else 1.0
        helps = [good and one > least for good, one in zip(helps, sure, strict=True)]
        if not all(helps) and any(helps) and trial.fit.who[-1].effect.threshold:
            # A surface does nothing in a motion that never comes near it, and little in one that touches it once. On such a
            # record, an effect with a threshold must only do no harm.
            others = zip(helps, shares[1:], self._idle(trial), strict=True)
            helps = [good or share > 0.0 or idle for good, share, idle in others]
        return all(helps)

    def _idle(self, trial: Hypothesis) -> list[bool]:
        """Tell for each record whether the last effect of an explanation changes less there than the noise hides."""
        change = self.both.residual(trial.fit.effects) - self.both.residual(trial.fit.effects[:-1])
        return [
            float((part**2).sum()) < _IDLE * floor for part, floor in zip(self.both.parts(change), self.floors, strict=True)
        ]


def _out_of_turn(best: Hypothesis, failed: dict[Candidate, int]) -> set[Candidate]:
    """Select candidates that failed beside about as many effects; those that failed beside fewer may help now."""
    return {who for who, count in failed.items() if len(best.fit.who) < count + _AGAIN}


def strained(fitted: EffectFit) -> bool:
    """Tell whether the last effect is so large that it probably stands in for something else."""
    candidate, values = fitted.who[-1], fitted.values[-1]
    return any(
        parameter.amplitude and bound != 0.0 and values[parameter.name] * np.sign(bound) > _STRAINED * abs(bound)
        for parameter in candidate.effect.parameters
        for bound in (parameter.low, parameter.high)
    )


def _spread(both: PooledResiduals, fitted: EffectFit) -> Array:
    """Compute standard deviations of a fit's parameters that include errors of the model. [P]."""
    return spread_of(both, fitted.effects, derivatives(both, fitted))
