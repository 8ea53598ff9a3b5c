"""A user's case of throws: a YAML file that names a model and records, diagnosed into a folder."""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gsbridge.errors import InputError
from gsbridge.files import atomic_file, write_json
from gsbridge.gap.contact.body import FreeBody, read_body
from gsbridge.gap.contact.findings import Diagnosis, Verification, findings_of
from gsbridge.gap.contact.identify import Identification, Rules, shift
from gsbridge.gap.contact.interval import intervals
from gsbridge.gap.contact.replay import HORIZON, PHASES, Replay
from gsbridge.gap.contact.setup import build_setup
from gsbridge.gap.contact.starts import check_fall
from gsbridge.gap.contact.throws import FEWEST, Throws, read_throws
from gsbridge.gap.diagnose import ROLES
from gsbridge.gap.effects import effect_of
from gsbridge.gap.yaml_file import read_yaml

_KEYS = ("model", "records", "columns", "units", "effects", "horizon")


@dataclass(frozen=True)
class Case:
    """A case of throws, checked.

    Args:
        model: The model file.
        body: Its content.
        throws: By role.
        names: Effects that may be the reason; None for all.
        horizon: Length that is replayed, s.
        reasons: Why its result is degraded.
    """

    model: Path
    body: FreeBody
    throws: Mapping[str, Throws]
    names: tuple[str, ...] | None
    horizon: float
    reasons: tuple[str, ...]


def read_case(path: str | Path) -> Case:
    """Read and check a case of throws.

    Raises:
        InputError: The file, its model or its throws cannot be used.
    """
    path = Path(path)
    content = read_yaml(path, "case", "docs/gap_objects.md")
    if not isinstance(content, Mapping) or "model" not in content or not isinstance(content.get("records"), Mapping):
        raise InputError(path, "a case needs 'model' and 'records'", "See docs/gap_objects.md")
    for key in content:
        if key not in _KEYS:
            raise InputError(path, f"the key '{key}' is unknown", f"Use only: {', '.join(_KEYS)}")
    body = read_body(path.parent / content["model"])
    build_setup(body)
    for name in content.get("effects") or ():
        if effect_of(name, str(path)).scope != "body":
            raise InputError(path, f"the effect '{name}' acts on mechanisms", "Name effects of a thrown body")
    throws = {}
    for role, file in content["records"].items():
        if role not in ROLES:
            raise InputError(path, f"the record '{role}' has no role", f"Name records {', '.join(ROLES)}")
        throws[role] = read_throws(path.parent / file, content.get("columns"), content.get("units"))
        check_fall(throws[role], body.figures["gravity"], path.parent / file)
    throws, reasons = split_throws(throws, path)
    names = tuple(content["effects"]) if content.get("effects") else None
    return Case(path.parent / content["model"], body, throws, names, float(content.get("horizon", HORIZON)), reasons)


def split_throws(throws: Mapping[str, Throws], source: str | Path) -> tuple[dict[str, Throws], tuple[str, ...]]:
    """Three roles from fewer, cut in the order of the throws, which is marked.

    Raises:
        InputError: A role would have too few throws.
    """
    out, reasons = dict(throws), ()
    missing = [role for role in ROLES if role not in throws]
    if "fit" in missing:
        raise InputError(source, "there are no throws 'fit'", "Name the first of them fit")
    if missing:
        whole = "select" if "select" in throws else "fit"
        parts = [role for role in ROLES if role == whole or role in missing]
        edges = np.linspace(0, len(throws[whole]), len(parts) + 1).astype(int)
        for role, first, last in zip(parts, edges[:-1], edges[1:], strict=True):
            out[role] = throws[whole].part(int(first), int(last))
        reasons = (f"the throws '{whole}' were cut into {' and '.join(parts)}, which share one day and one way of throwing",)
    for role in ROLES:
        if len(out[role]) < FEWEST:
            raise InputError(
                source, f"'{role}' has {len(out[role])} throws", f"Record at least {FEWEST} for each role, better 60"
            )
    return {role: out[role] for role in ROLES}, reasons


def diagnose_throws(
    body: FreeBody,
    throws: Mapping[str, Throws],
    *,
    names: Collection[str] | None = None,
    rules: Rules | None = None,
    horizon: float = HORIZON,
    seed: int = 0,
) -> Diagnosis:
    """Find out what the simulation of a thrown body lacks.

    Args:
        body: The model.
        throws: By role: `fit`, `select`, `verify`.
        names: Effects that may be the reason; None for all of a body.
        rules: Thresholds.
        horizon: Length that is replayed, s.
        seed: Of replicates and bootstraps.
    """
    begin = time.perf_counter()
    replays = {role: Replay(body, throws[role], horizon) for role in ROLES}
    finding = Identification(replays["fit"], replays["select"], names, rules, seed).run()
    select, verification, spans = replays["select"], None, []
    phases = select.phases()
    where = {phase: (phases[phase], phases[phase]) for phase in PHASES if phase in phases}
    if finding.best is not None:
        effects = finding.best.fit.effects
        third = replays["verify"]
        verification = Verification(float(third.errors().mean()), float(third.errors(effects).mean()), finding.floor)
        if finding.verdict == "named" and not verification.transfers:
            # It closed the gap where it was chosen, but not elsewhere: whatever is missing, it is something else.
            finding = shift(finding, "none_of_the_known")
        spans = intervals(replays["fit"], effects, np.random.default_rng([seed, 1]))
        after = select.phases(effects)
        where = {phase: (before, after[phase]) for phase, (before, _) in where.items()}
    return Diagnosis(body, finding, verification, tuple(spans), where, time.perf_counter() - begin)


def run_case(path: str | Path, out: str | Path, seed: int = 0) -> dict[str, Any]:
    """Diagnose a case of throws into `out`: `findings.json` and the amended `model.yaml`. Returns the findings.

    Raises:
        InputError: As `read_case`; nothing is written then.
    """
    case, out = read_case(path), Path(out)
    diagnosis = diagnose_throws(case.body, case.throws, names=case.names, horizon=case.horizon, seed=seed)
    findings = findings_of(diagnosis, case.throws, seed=seed, reasons=case.reasons)
    write_json(out / "findings.json", findings)
    amend_body(case.model, findings, out / "model.yaml")
    return findings


def amend_body(model: str | Path, findings: Mapping[str, Any], out: str | Path) -> None:
    """Write a copy of a body's model file with what `findings` names; without a name it is a plain copy.

    Args:
        model: The model file that was diagnosed.
        findings: As written to `findings.json`.
        out: The amended model; a URDF's path is made relative to it.
    """
    model, out = Path(model), Path(out)
    content = read_yaml(model, "model", "docs/gap_objects.md")
    if "urdf" in content:
        content["urdf"] = os.path.relpath((model.parent / content["urdf"]).resolve(), out.resolve().parent)
    content["effects"] = [*(content.get("effects") or []), *(dict(effect) for effect in findings["amended"])]
    evidence = {
        **{key: findings[key] for key in ("sentence", "verdict", "verify", "seed")},
        "intervals": {
            item["name"]: {key: row["interval90"] for key, row in item["parameters"].items()} for item in findings["effects"]
        }
        if findings["amended"]
        else {},
        "rivals": [{key: row[key] for key in ("effects", "behind")} for row in findings["rivals"][1:4]],
        "records": dict(findings["records"]),
    }
    if findings["verify"]:
        evidence["verify"] = {key: findings["verify"][key] for key in ("before", "after", "closure", "unit")}
    content["evidence"] = [*(content.get("evidence") or []), evidence]
    with atomic_file(out) as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")
