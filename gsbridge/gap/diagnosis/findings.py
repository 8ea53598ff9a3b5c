"""What a diagnosis says: its result in one layout and one sentence, whatever was measured."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np

from gsbridge.effects.base import Effect, Parameter
from gsbridge.effects.registry import Applied, Registry
from gsbridge.gap.diagnosis.chances import p_sentence
from gsbridge.gap.diagnosis.results import (
    ABSTAINING,
    LIKELY,
    TRANSFERS,
    AccountEntry,
    Candidate,
    Finding,
    GapAccount,
    Rules,
    Verification,
)
from gsbridge.geometry import Array

_LISTED = 5
"""Rivals that a sentence names."""

_NINETY = 1.645
"""Standard deviations either side of a 90 % interval."""

_SIMILAR = 0.95
"""Cosine of two signatures from which on a fit can hardly tell their effects apart."""


def _account_runs(diagnosis: Diagnosis) -> dict[str, int]:
    """Simulations of an account, where there is one."""
    return {} if diagnosis.account is None else {"account": diagnosis.account_runs}


@dataclass(frozen=True)
class Diagnosis:
    """Everything that was found about one case.

    Args:
        finding: Verdict and hypotheses.
        verification: On `verify`, where something was fitted.
        floor: Noise of each channel of `select`, SI units.
        bank_runs: Simulations of the bank, whether made now or read.
        runs: Simulations of this case beside it, to name what is missing and to judge that.
        seconds: Time that the whole diagnosis took, s.
        intervals: 90 % intervals of the best hypothesis' parameters, by effect, where its deviations do not tell them.
        figures: What the model's own figures were and become with these effects, by effect and parameter, where it has such.
        residual_map: Size of the gap in each phase before and after, where a case has phases.
        account: All effects that explain a part of the gap, where a case is told so; `verification` is of all of them then.
        warnings: What a reader must know before the figures.
        account_runs: Simulations for the account, beside those.
        instead: What is told instead of the best effects, where something else explains as much; empty otherwise.
        left_out: Begin and end of moments that do not count, s, by role.
    """

    finding: Finding
    verification: Verification | None
    floor: Mapping[str, float]
    bank_runs: int
    runs: int
    seconds: float
    intervals: tuple[Mapping[str, tuple[float, float]], ...] = ()
    figures: tuple[Mapping[str, tuple[float, float]], ...] = ()
    residual_map: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    account: GapAccount | None = None
    warnings: tuple[str, ...] = ()
    account_runs: int = 0
    instead: str = ""
    left_out: Mapping[str, Sequence[tuple[float, float]]] = field(default_factory=dict)

    @property
    def effects(self) -> tuple[Applied, ...]:
        """What may be added to the model: what was named, or the whole account, if it makes `verify` no worse.

        An account without a name must close a good part of the gap there: little may be anything.
        """
        verdict, account = self.finding.verdict, self.account
        if self.verification is None or not self.verification.accepted or self.finding.best is None:
            return ()
        if account is None:
            return self.finding.best.fit.effects if verdict == "named" else ()
        return account.effects if verdict in ("named", "ambiguous") or account.closes >= TRANSFERS else ()


class Measured(Protocol):
    """Measurements of one role of a case."""

    @property
    def digest(self) -> str:
        """SHA-256 of its files; empty where there are none."""
        ...

    def content_digest(self) -> str:
        """SHA-256 of its numbers."""


class Account:
    """Puts the findings of one kind of case into words and figures.

    Attributes:
        effects: What may be named.
        unit: Unit of the gap.
        scale: Factor from the diagnosis' own unit to that one.
        measured: What was measured, in the plural.
        others: What nothing was fitted to.
        agree: Sentence where nothing is missing; `{p}` is the p-value.
        alone: Sentence where a difference shows on `select` alone.
        unexcited: Sentence where most effects could not show.
    """

    effects: ClassVar[Registry[Any]]
    unit: ClassVar[str] = "noise"
    scale: ClassVar[float] = 1.0
    measured: ClassVar[str] = "records"
    others: ClassVar[str] = "a record"
    agree: ClassVar[str] = "Simulation and measurement agree within the noise (p = {p:.2g})."
    alone: ClassVar[str] = "A difference shows on 'select' alone; log another record of such motion and fit that one."
    unexcited: ClassVar[str] = (
        "No difference shows, but most effects could not show in these records: excite the mechanism more."
    )

    def findings_of(
        self, diagnosis: Diagnosis, parts: Mapping[str, Measured], *, seed: int, reasons: Collection[str] = (), **counts: Any
    ) -> dict[str, Any]:
        """Content of `findings.json`.

        Args:
            diagnosis: The diagnosis.
            parts: What was measured, by role.
            seed: Seed of replicates.
            reasons: Why the result is degraded.
            counts: Further entries about what was measured.
        """
        finding, scale = diagnosis.finding, self.scale
        reasons = [*reasons, *self.doubts(diagnosis)]
        residual_map = {phase: [scale * before, scale * after] for phase, (before, after) in diagnosis.residual_map.items()}
        return {
            "status": "degraded" if reasons else "pass",
            "reasons": reasons,
            **({"warnings": list(diagnosis.warnings)} if diagnosis.warnings else {}),
            "sentence": self.sentence(diagnosis),
            "verdict": finding.verdict,
            "something_remains": finding.something_remains,
            "effects": self.describe(diagnosis),
            **({} if diagnosis.account is None else {"account": self._account(diagnosis, diagnosis.account)}),
            "amended": [effect.record() for effect in diagnosis.effects],
            "ambiguous": list(finding.ambiguous),
            "p_value": finding.p_value,
            "p_remaining": finding.p_remaining,
            "rivals": [
                {
                    "effects": list(rival.names),
                    "behind": scale * (rival.score - finding.rivals[0][0].score),
                    "probability": chance,
                    "closure": rival.closure,
                }
                for rival, chance in finding.rivals
            ],
            "select": {"before": scale * finding.before, "after": scale * finding.after, "unit": self.unit},
            "verify": self._verified(diagnosis.verification),
            **({"residual_map": residual_map} if residual_map else {}),
            "noise_floor": dict(diagnosis.floor),
            **({"left_out": {role: list(spans) for role, spans in diagnosis.left_out.items()}} if diagnosis.left_out else {}),
            "unseen": list(finding.unseen),
            "simulations": {"bank": diagnosis.bank_runs, "case": diagnosis.runs, **_account_runs(diagnosis)},
            "seconds": diagnosis.seconds,
            **counts,
            "records": {role: part.digest or part.content_digest() for role, part in parts.items()},
            "seed": seed,
        }

    def doubts(self, diagnosis: Diagnosis) -> tuple[str, ...]:
        """Why a finding is less than an answer, beside what is known of the measurements."""
        return (diagnosis.instead,) if diagnosis.instead else ()

    def _verified(self, checked: Verification | None) -> dict[str, Any] | None:
        """What `verify` says about the best explanation."""
        if checked is None:
            return None
        tested = checked.p_remaining is not None
        return {
            "before": self.scale * checked.before,
            "after": self.scale * checked.after,
            "closure": checked.closure,
            **({} if tested else {"removed": 1.0 - checked.after / checked.before}),
            "accepted": checked.accepted,
            **({"p_remaining": checked.p_remaining} if tested else {}),
            "channels": {name: (self.scale * a, self.scale * b) for name, (a, b) in checked.channels.items()},
            "unit": self.unit,
        }

    def describe(self, diagnosis: Diagnosis) -> list[dict[str, Any]]:
        """Effects with units and 90 % intervals: the best hypothesis', or where nothing is named all of the account."""
        best, account = diagnosis.finding.best, diagnosis.account
        if best is None:
            return []
        if account is not None and account.entries and diagnosis.finding.verdict in ABSTAINING:
            return [self._entry(entry) for entry in account.entries]
        intervals = diagnosis.intervals or _by_deviations(diagnosis.finding)
        figures = diagnosis.figures or (None,) * len(intervals)
        return [
            self._described(*row) for row in zip(self.effects_of(best.fit), best.fit.effects, intervals, figures, strict=True)
        ]

    def _described(
        self,
        effect: Effect,
        applied: Applied,
        spans: Mapping[str, tuple[float, float]],
        figures: Mapping[str, tuple[float, float]] | None = None,
    ) -> dict[str, Any]:
        """One effect with units, 90 % intervals, and what the model's own figures were and become."""
        rows: dict[str, dict[str, Any]] = {}
        for parameter in effect.parameters:
            row = {"value": applied.parameters[parameter.name], "unit": self.unit_of(parameter)}
            rows[parameter.name] = row | {"interval90": list(spans[parameter.name])}
            called = effect.called(parameter.name)
            rows[parameter.name] |= {} if called == parameter.name else {"called": called}
            if figures:
                was, becomes = figures[parameter.name]
                rows[parameter.name] |= {"was": was, "becomes": becomes}
        about = {"name": applied.name, "joint": applied.joint, "title": effect.title, "hook": effect.hook}
        advice = {"confused_with": list(effect.confused_with), "tell_apart": effect.tell_apart, "instead": effect.advice}
        return {**about, "parameters": rows, **advice}

    def _account(self, diagnosis: Diagnosis, account: GapAccount) -> dict[str, Any]:
        """An account, line by line, and what remains."""
        return {
            "entries": [
                {
                    "label": str(entry.candidate),
                    **self._entry(entry),
                    "share": entry.share,
                    "verdict": entry.verdict,
                    "alternatives": list(entry.instead),
                }
                for entry in account.entries
            ],
            "explained": account.explained,
            "remains": {
                "channel": account.channel,
                "phase": account.phase,
                "size": self.scale * account.left,
                "unit": self.unit,
            },
        }

    def _entry(self, entry: AccountEntry) -> dict[str, Any]:
        """The effect of a line of an account."""
        spans = entry.spans or _spans(entry.candidate, entry.effect, entry.deviations, 1.0)
        return self._described(entry.candidate.effect, entry.effect, spans, entry.figures)

    def effects_of(self, fit: Any) -> list[Effect]:
        """Entries of the catalogue for the effects of a fit."""
        return [self.effects[applied.name] for applied in fit.effects]

    def unit_of(self, parameter: Parameter) -> str:
        """Unit of a parameter as findings have it."""
        return parameter.unit

    def sentence(self, diagnosis: Diagnosis) -> str:
        """The finding in words."""
        finding = diagnosis.finding
        if diagnosis.instead:
            return diagnosis.instead
        if finding.coloured and finding.untold:
            return (
                "No known effect: more than white noise is left, nothing learnt from one record holds on the other, and no two "
                "channels here measure the same motion, which would tell noise of another colour from motion. Log speeds, too."
            )
        if finding.coloured:
            return (
                "Simulation and measurement agree: what exceeds white noise is no motion, and nothing learnt from one record "
                "holds on the other."
            )
        if finding.verdict == "no_discrepancy":
            return self.agree.format(p=finding.p_value)
        if finding.verdict == "not_enough_excitation":
            return self.alone if finding.p_value < Rules.alarm else self.unexcited
        best = finding.best
        if best is None:
            return f"Something is missing ({p_sentence(finding.p_value)}), and no known effect could be fitted to it."
        if finding.verdict == "none_of_the_known":
            if diagnosis.account is not None and diagnosis.account.entries:
                return self._closest(diagnosis.account)
            names = " + ".join(best.names)
            return (
                f"Something is missing, and no single known effect suffices: the best one ({names}) {self.leaves(diagnosis)}."
            )
        if finding.verdict == "ambiguous":
            alike, more = finding.ambiguous[:_LISTED], len(finding.ambiguous) - _LISTED
            listed = " and ".join([*alike, f"{more} more"] if more > 0 else alike)
            how = self.effects[best.fit.effects[0].name].tell_apart
            return f"These {self.measured} cannot decide between {listed}. To tell them apart: {how}."
        parts = "; ".join(self.lacks(item) for item in self.describe(diagnosis))
        tail = "" if diagnosis.verification is None else f"; {self.change(diagnosis.verification)}"
        return parts + tail + (", but something remains" if finding.something_remains else "") + "."

    def _closest(self, account: GapAccount) -> str:
        """What comes nearest where nothing can be named, what it leaves, and what to do next."""
        first = account.entries[0]
        lines = [self._line(entry) for entry in account.entries[:_LISTED] if entry is first or abs(entry.share) >= 0.005]
        more = f" and {len(account.entries) - len(lines)} more" if len(account.entries) > len(lines) else ""
        rest = f", mostly in {account.channel}, {account.phase}" if account.channel else ""
        head = f"No single known effect suffices. Closest {'are' if account.entries[1:] else 'is'}"
        most = "Several known effects together explain most of the gap, none of them proven:"
        head = f"{most if account.explained >= TRANSFERS > first.share else head} {', '.join(lines)}{more}"
        if first.verdict == LIKELY and first.share >= TRANSFERS:
            head = f"Likely, not proven: {lines[0]}; no other known effect explains as much in its place"
            head += f". Beside it come {', '.join(lines[1:])}{more}".replace("come  and", "come") if account.entries[1:] else ""
        them, have = ("them", "they have") if account.entries[1:] else ("it", "it has")
        return (
            f"{head}. With {them} in the model, {100 * (1.0 - account.explained):.0f} % of the gap remains on {self.others} "
            f"that {have} not seen{rest}. Do this next: {first.candidate.effect.tell_apart}."
        )

    def _line(self, entry: AccountEntry) -> str:
        """An entry in a sentence, with its sizes."""
        figures = _figures(self._entry(entry)["parameters"])
        where = f"{entry.effect.joint}: " if entry.effect.joint else ""
        return f"{where}{entry.candidate.effect.title} ({figures}; {100 * entry.share:.0f} %)"

    def leaves(self, diagnosis: Diagnosis) -> str:
        """Sentence on what the nearest explanation leaves, where nothing can be named."""
        return f"leaves {diagnosis.finding.after:.3g} times the noise of {diagnosis.finding.before:.3g}"

    def lacks(self, item: Mapping[str, Any]) -> str:
        """One effect that the model lacks, with its figures; an entry of `describe`."""
        figures = _figures(item["parameters"])
        who = f"The model of joint '{item['joint']}'" if item["joint"] else "The model"
        return f"{who} lacks {item['title']} ({figures})"

    def change(self, checked: Verification) -> str:
        """Sentence on how the gap changes on `verify`."""
        verb = "falls" if checked.after <= checked.before else "rises"
        return f"the gap {verb} from {checked.before:.3g} to {checked.after:.3g} times the noise on a record it has not seen"


def _by_deviations(finding: Finding) -> tuple[Mapping[str, tuple[float, float]], ...]:
    """90 % intervals of the best hypothesis' parameters from their standard deviations, by effect."""
    fit, place, out = finding.best.fit, 0, []  # type: ignore[union-attr]
    # Residuals above the noise widen the intervals as they would under noise of that size.
    wide = max(1.0, finding.after)
    for candidate, effect in zip(fit.who, fit.effects, strict=True):
        count = len(candidate.effect.parameters)
        out.append(_spans(candidate, effect, fit.deviations[place : place + count], wide))
        place += count
    return tuple(out)


def _spans(candidate: Candidate, effect: Applied, deviations: Array, wide: float) -> dict[str, tuple[float, float]]:
    """90 % intervals of an effect's parameters from their standard deviations [P], made wider by a factor."""
    rows = {}
    for parameter, deviation in zip(candidate.effect.parameters, deviations, strict=True):
        value, spread = effect.parameters[parameter.name], _NINETY * wide * float(deviation)
        rows[parameter.name] = (max(value - spread, parameter.low), min(value + spread, parameter.high))
    return rows


def _figures(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """Parameters of a described effect in a sentence."""
    return ", ".join(
        f"{row.get('called', name)} {_rounded(row['value'], row['interval90'])} {row['unit']}".removesuffix(" 1").rstrip()
        for name, row in parameters.items()
    )


def digits_of(interval: Sequence[float], scale: float = 1.0) -> tuple[float, int]:
    """Half the width of an interval, and the decimals that show its second digit where it is multiplied by `scale`."""
    half = max(0.5 * (interval[1] - interval[0]), 1e-12)
    return half, max(0, int(1 - np.floor(np.log10(scale * half))))


def _rounded(value: float, interval: Sequence[float]) -> str:
    """A value with half the width of its interval, rounded to the width's second digit."""
    half, digits = digits_of(interval)
    return f"{value:.{digits}f} ± {half:.{digits}f}"


def similar_pairs(names: Sequence[str], cosines: Array) -> list[dict[str, Any]]:
    """Pairs of effects with similar signatures before any fit, the most similar first, as in `screen.json`.

    Args:
        names: Names of the effects. [N].
        cosines: Cosines between their signatures, the largest where they have several. [N, N].
    """
    pairs = [
        {"pair": [names[a], names[b]], "cosine": float(cosines[a, b])}
        for a in range(len(names))
        for b in range(a)
        if cosines[a, b] >= _SIMILAR
    ]
    return sorted(pairs, key=lambda item: -item["cosine"])
