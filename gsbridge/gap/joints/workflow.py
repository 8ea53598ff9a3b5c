"""The stages of the gap workflow for a case about a mechanism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError
from gsbridge.gap.diagnosis.backend import CaseBackend, stored_names
from gsbridge.gap.diagnosis.findings import similar_pairs
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.formats.records import TOOL, Record
from gsbridge.gap.formats.store import load_records, save_records
from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.candidates import candidates
from gsbridge.gap.joints.case import JointCase, read_joint_case
from gsbridge.gap.joints.diagnose import JointAccount, diagnose_joints, views_of
from gsbridge.gap.joints.mechanism.apply_effects import apply_effects
from gsbridge.gap.joints.mechanism.mechanism_model import read_mechanism_model
from gsbridge.gap.joints.mechanism.placeholders import impossible_told, placeholder_told
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.observer import observed, strays_told
from gsbridge.gap.joints.residual_map import map_residuals
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import cosines
from gsbridge.gap.joints.signatures import SignatureBank
from gsbridge.geometry import Array

_BEYOND = 1.2
"""Distance of a logged tool from the base, as a multiple of the mechanism's reach, beyond which it is refused."""


@dataclass(frozen=True)
class JointBackend(CaseBackend):
    """A case whose model is a mechanism; see `gsbridge.gap.diagnosis.backend.Backend`.

    Args:
        case: The case.
    """

    case: JointCase

    @classmethod
    def read(cls, path: str | Path) -> JointBackend:
        """Read a case from its file and check it.

        Raises:
            InputError: The case cannot be used.
        """
        case = read_joint_case(path)
        # Building the mechanism finds further faults of the model; they are reported here, before anything is written.
        mechanism = Mechanism(case.system)
        _refuse_far_tool(mechanism, case.records["fit"], Path(path))
        _refuse_runaway(mechanism, case.records["fit"], case.model)
        told = [reason for reason in (impossible_told(mechanism), placeholder_told(mechanism), observed(case)[1]) if reason]
        return cls(replace(case, reasons=(*case.reasons, *told)) if told else case)

    @cached_property
    def replayed(self) -> JointCase:
        """The case as it is replayed: pulled back to the measured motion if its model runs away from it."""
        return observed(self.case)[0]

    @classmethod
    def load(cls, model: str | Path, data: str | Path, about: Mapping[str, Any]) -> JointBackend:
        """Rebuild a case from the output of `save` and `about`.

        Args:
            model: File of the model.
            data: File that `save` wrote (`.npz`).
            about: Output of `about`, read from `records.json`.

        Raises:
            InputError: A file is missing or damaged.
        """
        system, records = read_mechanism_model(model), load_records(data)
        return cls(JointCase(Path(model), system, records, stored_names(about), tuple(about["reasons"])))

    def save(self, data: str | Path) -> None:
        """Write the records (`.npz`)."""
        save_records(data, self.case.records)

    def about(self) -> dict[str, Any]:
        """Return the content of `records.json`."""
        system, parts = self.case.system, {role: _about(item) for role, item in self.case.records.items()}
        sliding: dict[str, Any] = {"sliding": list(system.sliding)} if system.sliding else {}
        return self.described(system.digest(), system.controller.mode, parts, system.joints, **sliding)

    def compare(self) -> dict[str, Any]:
        """Compute the residuals of every channel under the unchanged model and map where they occur: `comparison.json`."""
        mechanism = Mechanism(self.replayed.system)
        views = views_of(mechanism, self.replayed.records)
        return {
            "unit": "noise",
            "records": {role: _residuals(view) for role, view in views.items()},
            "simulations": mechanism.runs,
        }

    def screen(self, bank: str | Path) -> dict[str, Any]:
        """Make the bank of signatures and report, before any fit, which effects the records can tell apart: `screen.json`."""
        mechanism = Mechanism(self.replayed.system)
        # Estimate the noise from all records, as the diagnosis does: the noise sets the sizes of the signatures in the bank.
        views = views_of(mechanism, self.replayed.records, bank)
        view = views["fit"]
        who = candidates(view, self.replayed.names, (views["select"],))
        found = signature_bank(view, who, bank)
        shown = {signature.candidate for signature in found.signatures}
        return {
            "candidates": [str(candidate) for candidate in who],
            "unseen": sorted(str(candidate) for candidate in set(who) - shown),
            "signature_similarity": _alike(view, found, who),
            "signatures": len(found.signatures),
            "simulations": found.runs,
        }

    def diagnose(self, bank: str | Path, seed: int) -> dict[str, Any]:
        """Diagnose the case and return the content of `findings.json`, verified on the third record."""
        case = self.replayed
        diagnosis = diagnose_joints(case.system, case.records, bank, names=case.names, seed=seed)
        reasons = case.reasons if case is self.case else (*case.reasons, strays_told(self.case, diagnosis.effects))
        account = JointAccount(self.case.system.controller.repeatable)
        return account.findings_of(diagnosis, case.records, seed=seed, reasons=reasons)

    def replay(self, effects: Sequence[Applied]) -> tuple[dict[str, Array], dict[str, Any]]:
        """Replay every record with the unchanged model and with effects.

        Returns:
            Arrays of the measured, nominal and explained motion with keys `{role}/{what}` (no `explained` if there are no
            effects), and the content of `replays.json`: residuals before and after, and a map of what remains.
        """
        mechanism = Mechanism(self.replayed.system)
        arrays: dict[str, Array] = {}
        rows = {}
        for role, item in self.replayed.records.items():
            # Estimate the noise from the residual of the replay with effects, which is closer to the record.
            view = JointResiduals.of(mechanism, item, effects)
            nominal, explained = view.simulate(), view.simulate(effects)
            before, after = view.residual(), view.residual(effects)
            arrays |= {f"{role}/time": item.time, f"{role}/sigma": view.sigma, f"{role}/measured": view.stack(item.measured)}
            arrays |= {f"{role}/nominal": view.stack(nominal), f"{role}/before": before}
            # If the joints were not measured, pictures show the commanded positions instead.
            seen = item.measured["position"] if "position" in item.measured else item.commands["command"]
            arrays |= {f"{role}/position": seen, f"{role}/nominal_position": nominal["position"]}
            if effects:
                arrays |= {f"{role}/explained": view.stack(explained), f"{role}/after": after}
                arrays[f"{role}/explained_position"] = explained["position"]
            rows[role] = {
                "before": float(np.sqrt((before**2).sum() / view.freedom)),
                "after": float(np.sqrt((after**2).sum() / view.freedom)),
                "joints_measured": "position" in item.measured,
                "channels": [item.label(kind, k) for kind, k in view.channels],
                "remains": map_residuals(view, after, explained).record(),
            }
        return arrays, {"unit": "noise", "records": rows, "simulations": mechanism.runs}


def _refuse_far_tool(mechanism: Mechanism, record: Record, source: Path) -> None:
    """Refuse a tool that is logged farther from the base than the mechanism reaches.

    Raises:
        InputError: The tool's places are in another unit, or in the frame of the tracker.
    """
    if TOOL not in record.measured:
        return
    far = float(np.median(np.linalg.norm(record.measured[TOOL], axis=1)))
    reach = mechanism.chain.reach(mechanism.tip, mechanism.toe)
    if far <= _BEYOND * reach:
        return
    looks = ": it looks like millimetres" if far <= 1e3 * _BEYOND * reach and far > 100.0 * reach else ""
    raise InputError(
        source, f"the tool of 'fit' is logged {far:.3g} m from the base, the model reaches {reach:.3g} m{looks}",
        "State the unit that was logged, e.g. [mm], and give places in the frame of the base",
    )  # fmt: skip


def _refuse_runaway(mechanism: Mechanism, record: Record, source: Path) -> None:
    """Refuse a model under feedback that is unstable without any effect, since no effect could be fitted to it.

    Raises:
        InputError: The replay of the record diverges.
    """
    if not mechanism.system.controller.closed_loop:
        return
    begin = record.measured.get("position", record.commands["command"])[0]
    state = (begin, np.zeros_like(begin))
    moved = mechanism.run(record, apply_effects(mechanism, ()), [(0, len(record.time))], [state])["position"]
    lost = np.flatnonzero(~np.isfinite(moved).all(axis=1))
    if len(lost):
        raise InputError(
            source, f"the model itself is unstable: it runs away after {record.time[lost[0]]:.3g} s of the replay of 'fit'",
            "Check the units of stiffness and damping; state 'armature' of light joints, or raise 'physics_rate'",
        )  # fmt: skip


def _about(record: Record) -> dict[str, Any]:
    """Summarise a record for a reader: its size, rates, channels and digest."""
    return {
        "name": record.name,
        "samples": len(record.time),
        "seconds": record.duration,
        "rate_hz": 1.0 / record.period,
        "commands": sorted(record.commands),
        "measured": sorted(record.measured),
        "quantum": {kind: values.tolist() for kind, values in record.quantum.items()},
        "digest": record.digest or record.content_digest(),
    }


def _residuals(view: JointResiduals) -> dict[str, Any]:
    """Report the size of one record's residuals, the noise of its channels, and where the residuals occur."""
    residual = view.residual()
    found = map_residuals(view, residual, view.simulate())
    return {
        "whole": float(np.sqrt((residual**2).sum() / view.freedom)),
        "channels": dict(zip(found.channels, np.sqrt((residual**2).mean(axis=0)).tolist(), strict=True)),
        "noise": dict(zip(found.channels, view.sigma.tolist(), strict=True)),
        "residual_map": found.record(),
    }


def _alike(view: JointResiduals, bank: SignatureBank, who: Sequence[Candidate]) -> list[dict[str, Any]]:
    """List pairs of candidates whose signatures are similar on this record, the most similar first."""
    first: dict[Candidate, Any] = {}
    for signature in bank.signatures:
        first.setdefault(signature.candidate, signature)
    chosen = [first[candidate] for candidate in who if candidate in first]
    return similar_pairs([str(item.candidate) for item in chosen], np.abs(cosines(view, chosen))) if chosen else []
