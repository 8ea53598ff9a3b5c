"""What a diagnosis of throws says, in the layout of `gsbridge.gap.joints.diagnose.findings_of`, lengths in millimetres."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.gap.contact.diagnose import TRANSFERS, Diagnosis
from gsbridge.gap.contact.setup import body_setup
from gsbridge.gap.contact.throws import Throws

UNIT = "mm"


def findings_of(
    diagnosis: Diagnosis, throws: Mapping[str, Throws], *, seed: int, reasons: Collection[str] = ()
) -> dict[str, Any]:
    """What `findings.json` holds.

    Args:
        diagnosis: The diagnosis.
        throws: By role.
        seed: As given to `diagnose_throws`.
        reasons: Why the result is degraded.
    """
    finding, checked = diagnosis.finding, diagnosis.verification
    return {
        "status": "degraded" if reasons else "pass",
        "reasons": list(reasons),
        "sentence": sentence(diagnosis),
        "verdict": finding.verdict,
        "something_remains": finding.something_remains,
        "effects": describe(diagnosis),
        "amended": [effect.record() for effect in diagnosis.effects],
        "ambiguous": list(finding.ambiguous),
        "p_value": finding.p_value,
        "p_remaining": finding.p_remaining,
        "rivals": [
            {
                "effects": list(trial.names),
                "behind": 1e3 * (trial.error - finding.rivals[0][0].error),
                "probability": chance,
                "closure": finding.closure(trial.error),
            }
            for trial, chance in finding.rivals
        ],
        "select": {"before": 1e3 * finding.before, "after": 1e3 * finding.after, "unit": UNIT},
        "verify": None
        if checked is None
        else {
            "before": 1e3 * checked.before,
            "after": 1e3 * checked.after,
            "closure": checked.closure,
            "removed": 1.0 - checked.after / checked.before,
            "accepted": checked.accepted,
            "channels": {"position": (1e3 * checked.before, 1e3 * checked.after)},
            "unit": UNIT,
        },
        "where": {phase: [1e3 * before, 1e3 * after] for phase, (before, after) in diagnosis.where.items()},
        "noise_floor": {"position": finding.floor},
        "unseen": list(finding.unseen),
        "simulations": {"bank": diagnosis.bank_runs, "case": diagnosis.runs},
        "seconds": diagnosis.seconds,
        "throws": {role: len(items) for role, items in throws.items()},
        "records": {role: items.digest or items.content_digest() for role, items in throws.items()},
        "seed": seed,
    }


def describe(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Parameters of the best trial's effects with units, 90 % intervals, and what the model's own figures were and become."""
    best = diagnosis.finding.best
    if best is None:
        return []
    was, became = (body_setup(diagnosis.body, effects).figures for effects in ((), best.fit.effects))
    out = []
    for applied, spans in zip(best.fit.effects, diagnosis.intervals, strict=True):
        effect = BODY_EFFECTS[applied.name]
        rows = {
            parameter.name: {
                "value": applied.parameters[parameter.name],
                "unit": "" if parameter.unit == "1" else parameter.unit,
                "interval90": list(spans[parameter.name]),
                "was": was[effect.figures[parameter.name]],
                "becomes": became[effect.figures[parameter.name]],
            }
            for parameter in effect.parameters
        }
        out.append(
            {
                "name": applied.name,
                "joint": "",
                "title": effect.title,
                "hook": effect.hook,
                "parameters": rows,
                "confused_with": list(effect.confused_with),
                "tell_apart": effect.tell_apart,
            }
        )
    return out


def sentence(diagnosis: Diagnosis) -> str:
    """The finding in words."""
    finding, checked = diagnosis.finding, diagnosis.verification
    before, after, floor = (f"{1e3 * value:.3g} mm" for value in (finding.before, finding.after, finding.floor))
    if finding.verdict == "no_discrepancy":
        return f"Simulated and measured throws agree within noise and chaos (p = {finding.p_value:.2g})."
    if finding.verdict == "not_enough_excitation":
        return "No difference shows, but most effects could not show in these throws: let the body hit, slide and turn."
    best = finding.best
    if best is None:
        return f"Something is missing (p = {finding.p_value:.2g}), and no known effect could be fitted to it."
    names = " + ".join(best.names)
    if finding.verdict == "none_of_the_known":
        seen = f"leaves {after} of {before}, where noise and chaos explain {floor}"
        if checked is not None and not checked.transfers and finding.closure(finding.after) >= TRANSFERS:
            seen = f"closes {checked.closure:.0%} of the gap on throws that it has not seen"
        return f"Something is missing that is in no catalogue: the best known explanation ({names}) {seen}."
    if finding.verdict == "ambiguous":
        how = BODY_EFFECTS[best.fit.effects[0].name].tell_apart
        return f"These throws cannot decide between {' and '.join(finding.ambiguous)}. To tell them apart: {how}."
    parts = []
    for item in describe(diagnosis):
        share = BODY_EFFECTS[item["name"]].relative
        figures = ", ".join(
            _figure("" if len(item["parameters"]) == 1 else name.replace("_", " "), row, share)
            for name, row in item["parameters"].items()
        )
        parts.append(f"{item['title'][0].upper()}{item['title'][1:]}: {figures}")
    tail = ""
    if checked is not None:
        verb = "falls" if checked.after <= checked.before else "rises"
        sizes = f"{1e3 * checked.before:.3g} to {1e3 * checked.after:.3g} mm"
        tail = f"; the mean distance {verb} from {sizes} on throws it has not seen"
    return "; ".join(parts) + tail + (", but something remains" if finding.something_remains else "") + "."


def _figure(name: str, row: Mapping[str, Any], share: bool) -> str:
    """What a figure of the model becomes, with half the width of its interval, and what it was; shares in per cent."""
    half = max(0.5 * (row["interval90"][1] - row["interval90"][0]), 1e-12)
    scale = 100.0 if share else 1.0
    digits = max(0, int(1 - np.floor(np.log10(scale * half))))
    if share:
        text = f"{100 * row['value']:+.{digits}f} ± {100 * half:.{digits}f} %"
    else:
        text = f"{row['becomes']:.{digits}f} ± {half:.{digits}f} {row['unit']}".rstrip() + f" instead of {row['was']:.3g}"
    return f"{name} {text}".lstrip()
