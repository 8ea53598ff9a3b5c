"""The result of a diagnosis in one layout and one sentence, for any kind of case."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

from gsbridge.effects.base import Effect, Parameter
from gsbridge.effects.registry import Applied, Registry
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
from gsbridge.gap.diagnosis.wording import channel_name, p_sentence, plain, rounded
from gsbridge.geometry import Array

_LISTED = 5
"""Largest number of rivals or entries that a sentence names."""

_NINETY = 1.645
"""Half width of a 90 % interval, in standard deviations."""

_SIMILAR = 0.95
"""Cosine of two signatures at or above which a fit can hardly tell their effects apart."""


def _account_runs(diagnosis: Diagnosis) -> dict[str, int]:
    """Return the number of simulations of an account, if there is one."""
    return {} if diagnosis.account is None else {"account": diagnosis.account_runs}


@dataclass(frozen=True)
class Diagnosis:
    """Everything that was found about one case.

    Args:
        finding: Verdict and hypotheses.
        verification: Result on `verify`; None if nothing was fitted.
        floor: Noise of each channel of `select`, SI units.
        bank_runs: Simulations of the bank, whether run now or read from its folder.
        runs: Simulations of this case to name what is missing and to judge the name; without the bank and the account.
        seconds: Time that the whole diagnosis took, s.
        intervals: 90 % intervals of the best hypothesis' parameters, by effect, if they do not follow from its deviations.
        figures: Old and new value of the model's own figures, by effect and parameter, if it has such figures.
        residual_map: Size of the gap before and after in each phase, if the case has phases.
        account: All effects that explain a part of the gap, if there is an account; `verification` then covers all of them.
        warnings: What a reader must know before reading the figures.
        account_runs: Simulations for the account.
        instead: Sentence that replaces the best effects if something else explains as much; empty otherwise.
        left_out: Start and end of the moments that are left out of the comparison, s, by role.
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
        """Effects to add to the model: the named ones or the whole account, if they do not make `verify` worse.

        An account without a name must close at least `TRANSFERS` of the gap there: a small share could come from anything.
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
    """Turns the findings of one kind of case into words and figures.

    Attributes:
        effects: Catalogue of the effects that may be named.
        unit: Unit of the gap.
        scale: Factor from the diagnosis' own unit to `unit`.
        measured: Word for the measurements, in the plural.
        others: Phrase for the held-out measurements.
        agree: Sentence for the case that nothing is missing; `{p}` is the p-value.
        alone: Sentence for a difference that shows only on `select`.
        unexcited: Sentence for records in which most effects could not show.
    """

    effects: ClassVar[Registry[Any]]
    unit: ClassVar[str] = "noise"
    scale: ClassVar[float] = 1.0
    measured: ClassVar[str] = "records"
    others: ClassVar[str] = "a record"
    agree: ClassVar[str] = "Simulation and measurement differ by no more than the noise (p = {p:.2g})."
    alone: ClassVar[str] = "A difference shows on 'select' alone; log another record of such motion and fit that one."
    unexcited: ClassVar[str] = (
        "No difference shows, but most effects could not show in these records: excite the mechanism more."
    )

    def findings_of(
        self, diagnosis: Diagnosis, parts: Mapping[str, Measured], *, seed: int, reasons: Collection[str] = (), **counts: Any
    ) -> dict[str, Any]:
        """Return the content of `findings.json`.

        Args:
            diagnosis: The diagnosis.
            parts: The measurements, by role.
            seed: Random seed of the noise replicates.
            reasons: Why the result is degraded.
            counts: Further entries about the measurements.
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
        """Return further reasons why the result is degraded, those that come from the diagnosis itself."""
        return (diagnosis.instead,) if diagnosis.instead else ()

    def _verified(self, checked: Verification | None) -> dict[str, Any] | None:
        """Return the entry `verify` of the findings: how the best explanation does on that record."""
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
        """Return effects with units and 90 % intervals: the account's if nothing is named, else the best hypothesis'."""
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
        """Return one effect with units, 90 % intervals, and the old and new values of the model's own figures."""
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
        """Return the entries of an account, and what remains."""
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
        """Return the effect of an entry of an account, as `_described` lays it out."""
        spans = entry.spans or _spans(entry.candidate, entry.effect, entry.deviations, 1.0)
        return self._described(entry.candidate.effect, entry.effect, spans, entry.figures)

    def effects_of(self, fit: Any) -> list[Effect]:
        """Return the catalogue's entries for the effects of a fit."""
        return [self.effects[applied.name] for applied in fit.effects]

    def unit_of(self, parameter: Parameter) -> str:
        """Return the unit in which findings state a parameter."""
        return parameter.unit

    def sentence(self, diagnosis: Diagnosis) -> str:
        """Return the finding as a sentence."""
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
                "Simulation and measurement differ by no more than noise: what exceeds white noise is no motion, and nothing "
                "learnt from one record holds on the other."
            )
        if finding.verdict == "no_discrepancy":
            return self.agree.format(p=finding.p_value)
        if finding.verdict == "not_enough_excitation":
            return self.alone if finding.p_value < Rules.alarm else self.unexcited
        best = finding.best
        if best is None:
            missing = f"Something is missing ({p_sentence(finding.p_value)})"
            return f"{missing}, and no known effect explains it so well on one part of the data that it holds on another."
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
        """Return the sentences for an account without a name: the closest effects, what they leave, and what to do next."""
        first = account.entries[0]
        lines = [self._line(entry) for entry in account.entries[:_LISTED] if entry is first or abs(entry.share) >= 0.005]
        more = f" and {len(account.entries) - len(lines)} more" if len(account.entries) > len(lines) else ""
        rest = f", mostly in the {channel_name(account.channel)}, {account.phase}" if account.channel else ""
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
        """Return an entry as part of a sentence, with its parameters and its share."""
        figures = _figures(self._entry(entry)["parameters"])
        where = f"{entry.effect.joint}: " if entry.effect.joint else ""
        return f"{where}{entry.candidate.effect.title} ({figures}; {100 * entry.share:.0f} %)"

    def leaves(self, diagnosis: Diagnosis) -> str:
        """Return the words for what the best explanation leaves when nothing can be named."""
        return f"leaves {plain(diagnosis.finding.after)} times the noise of {plain(diagnosis.finding.before)}"

    def lacks(self, item: Mapping[str, Any]) -> str:
        """Return the words for one effect that the model lacks (`item` is an entry of `describe`), with its figures."""
        figures = _figures(item["parameters"])
        who = f"The model of joint '{item['joint']}'" if item["joint"] else "The model"
        return f"{who} lacks {item['title']} ({figures})"

    def change(self, checked: Verification) -> str:
        """Return the words for how the gap changes on `verify`."""
        verb = "falls" if checked.after <= checked.before else "rises"
        return (
            f"the gap {verb} from {plain(checked.before)} to {plain(checked.after)} times the noise on a record it has not seen"
        )


def _by_deviations(finding: Finding) -> tuple[Mapping[str, tuple[float, float]], ...]:
    """Return 90 % intervals of the best hypothesis' parameters from their standard deviations, by effect."""
    fit, place, out = finding.best.fit, 0, []  # type: ignore[union-attr]
    # Residuals above the noise are treated as noise of that size, which widens the intervals.
    wide = max(1.0, finding.after)
    for candidate, effect in zip(fit.who, fit.effects, strict=True):
        count = len(candidate.effect.parameters)
        out.append(_spans(candidate, effect, fit.deviations[place : place + count], wide))
        place += count
    return tuple(out)


def _spans(candidate: Candidate, effect: Applied, deviations: Array, wide: float) -> dict[str, tuple[float, float]]:
    """Return 90 % intervals of an effect's parameters from their standard deviations [P] times the factor `wide`."""
    rows = {}
    for parameter, deviation in zip(candidate.effect.parameters, deviations, strict=True):
        value, spread = effect.parameters[parameter.name], _NINETY * wide * float(deviation)
        rows[parameter.name] = (max(value - spread, parameter.low), min(value + spread, parameter.high))
    return rows


def _figures(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the parameters of a described effect as part of a sentence."""
    return ", ".join(
        f"{row.get('called', name)} {rounded(row['value'], row['interval90'])} {row['unit']}".removesuffix(" 1").rstrip()
        for name, row in parameters.items()
    )


def similar_pairs(names: Sequence[str], cosines: Array) -> list[dict[str, Any]]:
    """Return the pairs of effects with similar signatures, the most similar first, as they are stored in `screen.json`.

    Args:
        names: Names of the effects. [N].
        cosines: Cosines between their signatures; the largest one if effects have several signatures. [N, N].
    """
    pairs = [
        {"pair": [names[a], names[b]], "cosine": float(cosines[a, b])}
        for a in range(len(names))
        for b in range(a)
        if cosines[a, b] >= _SIMILAR
    ]
    return sorted(pairs, key=lambda item: -item["cosine"])
