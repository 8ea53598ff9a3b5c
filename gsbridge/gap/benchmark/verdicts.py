"""Comparison of findings with their truths, after a check of the truths' seals."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.gap.benchmark.body_cases import BODY
from gsbridge.gap.benchmark.photo_cases import SAME, photo_closure
from gsbridge.gap.diagnosis.results import ABSTAINING, SILENT, says_likely
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.geometry import Array

OUTCOMES = ("right", "covered", "abstained", "missed", "wrong", "quiet", "false_alarm")
"""Outcomes of a case.

If something was hidden: `right` (named, or ambiguous only among the truth and its twins), `covered` (ambiguous, with the truth
among the explanations), `abstained` (a discrepancy was seen but nothing named), `missed` (no discrepancy was seen) and `wrong`
(another name, or an ambiguous set without the truth). If nothing was hidden: `quiet` or `false_alarm`."""

_GUESSED, _OPEN, _NAMED = 0.0, 1.0, 2.0
"""Offsets of sureness that rank this package's guesses: from an account, from an ambiguous verdict, and from a name."""

_EFFECTS = {**JOINT_EFFECTS, **BODY_EFFECTS}

_SHOWS = {"base_tilt": "about_y"}
"""The parameter to which a truth's size refers, for effects where it is not the first one."""


@dataclass(frozen=True)
class JudgedCase:
    """One diagnosed case.

    Args:
        hidden: Names of the hidden effects, with joints if the mechanism has several.
        units: Size of each hidden effect, in units of the detection limit.
        verdict: One of `gsbridge.gap.diagnosis.results.VERDICTS`.
        named: Names of the effects in the best explanation.
        sets: Names of the effects in each explanation between which the data cannot decide.
        simulations: Number of simulations, apart from those for the bank of signatures.
        bank: Number of simulations for the bank of signatures.
        seconds: Duration of the diagnosis, s.
        closure: Share of the gap on the noise-free record `verify` that the named effects close,
            1 - (after - floor) / (before - floor). The floor is the gap to a truth with nothing hidden, which is due to the
            difference between the engines. None if nothing was named.
        left: Residual on `verify` with the named effects, in units of the noise.
        covers: Whether the 90 % interval contains the true value, for each compared parameter of the named effects.
        parameters: The same, by the names of effect and parameter.
        chance: Stated probability that the first explanation is the best; None without an explanation.
        key: Key of the case.
        kind: Kind of the case.
        known: Whether the hidden effects are in the catalogue.
        twins: Sets of effects with the same equation as the hidden ones, which no data can tell apart.
        sureness: How sure the method is of its guess, by measure; larger is surer. Empty without a guess.
        decides: Whether the method always names a single explanation; one of the twins is then right as well.
        guess: The answer if the method did not abstain: the named effects, else the likeliest explanation, else the account.
        likely: Whether the method names nothing but calls its explanation likely.
    """

    hidden: frozenset[str]
    units: float
    verdict: str
    named: frozenset[str]
    sets: tuple[frozenset[str], ...] = ()
    simulations: int = 0
    bank: int = 0
    seconds: float = 0.0
    closure: float | None = None
    left: float | None = None
    covers: tuple[bool, ...] = ()
    parameters: Mapping[str, bool] = field(default_factory=dict)
    chance: float | None = None
    key: str = ""
    kind: str = "single"
    known: bool = True
    twins: tuple[frozenset[str], ...] = ()
    sureness: Mapping[str, float] = field(default_factory=dict)
    decides: bool = False
    guess: frozenset[str] = frozenset()
    likely: bool = False

    @property
    def guessed_right(self) -> bool:
        """Whether the guess is what was hidden or a twin of it; never if what was hidden is not in the catalogue."""
        return bool(self.guess) and self.known and self.guess in {self.hidden, *self.twins}

    @property
    def outcome(self) -> str:
        """The outcome, one of `OUTCOMES`. If what was hidden is not in the catalogue, every name is `wrong`."""
        silent = self.verdict in SILENT
        if not self.hidden:
            return "quiet" if silent else "false_alarm"
        if silent:
            return "missed"
        if self.verdict in ABSTAINING:
            return "abstained"
        if not self.known:
            return "wrong"
        if self.verdict == "ambiguous":
            if self.hidden not in self.sets:
                return "wrong"
            return "right" if set(self.sets) <= {self.hidden, *self.twins} else "covered"
        right = {self.hidden, *self.twins} if self.decides else {self.hidden}
        return "right" if self.named in right else "wrong"

    @property
    def answer(self) -> str:
        """The answer of the diagnosis, as one column of a confusion matrix."""
        if self.verdict == "named":
            return " + ".join(sorted(self.named))
        if self.verdict == "ambiguous":
            return "one of " + " | ".join(sorted(" + ".join(sorted(item)) for item in self.sets))
        return self.verdict


def read_verdicts(cases: str | Path, truths: str | Path, folders: Sequence[str | Path]) -> list[JudgedCase]:
    """Read the findings of one method and compare them with their truths.

    Args:
        cases: Folder of cases that `generate_cases` made.
        truths: Folder of their truths, from the same call.
        folders: Folders that together hold the findings.

    Raises:
        InputError: A truth or a record was changed, or a finding is missing.
    """
    manifest = read_json(Path(cases) / "manifest.json")
    out = []
    for row in manifest["cases"]:
        key = row["key"]
        truth = _sealed(Path(truths), key, row["truth_sha256"])
        found = next((Path(folder) / f"{key}.json" for folder in folders if (Path(folder) / f"{key}.json").exists()), None)
        if found is None:
            raise InputError(Path(folders[0]), f"the finding of case {key} is missing", "Diagnose all cases first")
        finding = read_json(found)
        out.append(_closed(_verdict(finding, truth), finding, truth, Path(cases) / key, Path(truths)))
    return out


def _sealed(truths: Path, key: str, digest: str) -> dict[str, Any]:
    """Read a truth after checking its seal.

    Raises:
        InputError: The truth or its noise-free record was changed after the case was made.
    """
    path, clean = truths / f"{key}.json", truths / f"{key}.npz"
    truth = read_json(path)
    if hashlib.sha256(path.read_bytes()).hexdigest() != digest:
        raise InputError(path, "the truth was changed after its case was made", "Generate the cases again")
    if not clean.exists() or hashlib.sha256(clean.read_bytes()).hexdigest() != truth["clean_sha256"]:
        raise InputError(clean, "the noise-free record was changed after its case was made", "Generate the cases again")
    return truth


def _name(effect: Mapping[str, Any], single: bool) -> str:
    """Return an effect's name as truths write it: without the joint if there is only one joint."""
    return effect["name"] if single or not effect.get("joint") else f"{effect['name']}:{effect['joint']}"


def _verdict(finding: Mapping[str, Any], truth: Mapping[str, Any]) -> JudgedCase:
    single = truth["plant"] == "axis"
    short = (lambda name: name.split(":")[0]) if single else (lambda name: name)
    covers = _covers(finding, truth) if finding["verdict"] == "named" else {}
    rivals = finding["rivals"]
    sure, guess = _guess(finding, short)
    return JudgedCase(
        frozenset(truth["hidden"]),
        float(truth["units"]),
        finding["verdict"],
        frozenset(_name(effect, single) for effect in finding["effects"]),
        tuple(frozenset(short(name) for name in item.split(" + ")) for item in finding["ambiguous"]),
        int(finding["simulations"]["case"]),
        int(finding["simulations"]["bank"]),
        float(finding["seconds"]),
        covers=tuple(covers.values()),
        parameters=covers,
        chance=float(rivals[0]["probability"]) if rivals else None,
        key=truth["key"],
        kind=truth["kind"] if truth["kind"] != "free" else f"free, {truth['noise']} noise",
        known=bool(truth["known"]),
        twins=tuple(frozenset(names) for names in truth["twins"]),
        sureness=sure,
        decides="sureness" in finding,
        guess=guess,
        likely=says_likely(finding),
    )


def _guess(finding: Mapping[str, Any], short: Callable[[str], str]) -> tuple[Mapping[str, float], frozenset[str]]:
    """Return how sure a method is of its guess, and the guess.

    Baselines state how sure they are. The findings of this package are ranked in three groups: named, then ambiguous, both by
    the probability of being best; then abstentions with an account, by the share that the account explains.
    """
    verdict, account = finding["verdict"], finding.get("account") or {}
    named = frozenset(short(_label(effect)) for effect in finding["effects"])
    if "sureness" in finding:
        return finding["sureness"], named
    if verdict in ("named", "ambiguous"):
        first = finding["rivals"][0]
        begin = _NAMED if verdict == "named" else _OPEN
        best = named if verdict == "named" else frozenset(short(name) for name in first["effects"])
        return {"rank": begin + first["probability"]}, best
    entries = account.get("entries") or []
    if verdict in ABSTAINING and entries:
        explained = min(max(account["explained"], 0.0), 1.0)
        return {"rank": _GUESSED + explained}, frozenset(short(entry["label"]) for entry in entries)
    return {}, frozenset()


def _label(effect: Mapping[str, Any]) -> str:
    """Return an effect's name with its joint, as accounts and rivals write it."""
    return f"{effect['name']}:{effect['joint']}" if effect.get("joint") else str(effect["name"])


def _covers(finding: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, bool]:
    """Return whether 90 % intervals contain the true values, by effect and parameter, for named effects that were hidden."""
    single, photos, out = truth["plant"] == "axis", truth["plant"] == "camera", {}
    for effect in finding["effects"]:
        name = _name(effect, single)
        if name not in truth["hidden"] or (photos and name not in SAME):
            continue
        shown = SAME[name] if photos else _SHOWS.get(effect["name"], _EFFECTS[effect["name"]].parameters[0].name)
        # Truths of bodies list all comparable parameters; there are none if the hidden law is not the catalogue's.
        told = truth.get("parameters", {}).get(name, {})
        true = told or ({} if truth["plant"] == BODY else {shown: truth["hidden"][name]})
        for parameter, value in true.items():
            low, high = effect["parameters"][parameter]["interval90"]
            if high > low:
                out[f"{name}.{parameter}"] = bool(low <= value <= high)
    return out


def _closed(
    verdict: JudgedCase, finding: Mapping[str, Any], truth: Mapping[str, Any], folder: Path, truths: Path
) -> JudgedCase:
    """Add the share of the gap that the named effects close; see `JudgedCase.closure`."""
    if verdict.verdict != "named" or not verdict.hidden:
        return verdict
    if truth["plant"] == BODY:
        return replace(verdict, closure=finding["verify"]["closure"])
    effects = tuple(Applied(e["name"], e.get("joint", ""), e["parameters"]) for e in _applied(finding))
    with np.load(truths / f"{verdict.key}.npz") as data:
        arrays = {name: data[name] for name in data.files}
    if truth["plant"] == "camera":
        closure, after = photo_closure(folder, arrays["clean"], arrays["plain"], effects)
        return replace(verdict, closure=closure, left=None if closure is None else float(np.hypot(1.0, after)))
    content = read_joint_case(folder / "case.yaml")
    plain = {name.removeprefix("plain_"): values for name, values in arrays.items() if name.startswith("plain_")}
    clean = {name: arrays[name] for name in plain}
    sigma = {kind: np.asarray(values, dtype=np.float64) for kind, values in truth["sigma"].items()}
    record, mechanism = content.records["verify"], Mechanism(content.system)

    def gap(measured: Mapping[str, Array], effects: tuple[Applied, ...]) -> float:
        view = JointResiduals.of(mechanism, replace(record.with_measured(measured), sigma=sigma, quantum={}))
        return float(np.sqrt((view.residual(effects) ** 2).mean()))

    floor, before, after = gap(plain, ()), gap(clean, ()), gap(clean, effects)
    closure = 1.0 - max(after - floor, 0.0) / max(before - floor, 1e-12)
    return replace(verdict, closure=closure, left=float(np.hypot(1.0, after)))


def _applied(finding: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the named effects with plain numbers as parameters."""
    rows = finding["effects"]
    return [{**row, "parameters": {name: item["value"] for name, item in row["parameters"].items()}} for row in rows]
