"""What a gap report says in words: what remains, what to do next, and where the difference shows most."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.joints import JOINT_EFFECTS
from gsbridge.gap.diagnosis.results import TRANSFERS, Rules, says_likely
from gsbridge.gap.diagnosis.wording import amount, channel_name, p_sentence, place

LABELS = {
    "no_discrepancy": ("no discrepancy", "good"),
    "named": ("named", "good"),
    "ambiguous": ("ambiguous", "warn"),
    "likely": ("likely, not proven", "warn"),
    "together": ("likely together, none proven", "warn"),
    "none_of_the_known": ("none of the known effects", "warn"),
    "not_attributable": ("something remains, not attributable", "warn"),
    "not_enough_excitation": ("not enough excitation", "warn"),
}
"""Title of each verdict, and its tone: whether it is an answer. `likely` stands for findings of which `says_likely` is true,
`together` for those that name nothing, but whose account closes as much of the gap as a name must."""

_UNFITTED = {
    "not_attributable": "nothing learnt from some throws holds on others",
    "not_enough_excitation": "the difference shows on 'select' alone, so that nothing could be learnt from 'fit'",
}
"""Reasons why nothing is explained, by verdict; otherwise no effect was fitted."""

_PROOFS = 2
"""Largest number of experiments that are proposed."""


def head(found: Mapping[str, Any]) -> dict[str, Any]:
    """Collect the head of a page about findings, by the names that its template asks for."""
    label, tone = LABELS[_answer(found)]
    return {
        "verdict": label,
        "tone": tone,
        "remaining": found["something_remains"] and found["verdict"] == "named",
        "reasons": found["reasons"],
        "sentence": found["sentence"],
    }


def _answer(found: Mapping[str, Any]) -> str:
    """Name the entry of `LABELS` for some findings."""
    if says_likely(found):
        return "likely"
    account = found.get("account") or {"entries": []}
    if found["verdict"] == "none_of_the_known" and account["entries"]:
        return "together" if account["explained"] >= TRANSFERS > account["entries"][0]["share"] else found["verdict"]
    return found["verdict"]


def explanation(names: Any) -> str:
    """Join the names of an explanation, effects with their joints; a text that is joined already is returned as it is."""
    return names if isinstance(names, str) else " + ".join(names)


def effect_title(name: str) -> str:
    """Title of an effect such as `coulomb:axis`, with its joint; the words of its name where no catalogue has a title."""
    word, _, joint = name.partition(":")
    effect = JOINT_EFFECTS.get(word) or BODY_EFFECTS.get(word)
    title = effect.title if effect else word.replace("_", " ")
    return f"{title} at {joint}" if joint else title


def explanation_title(names: Any) -> str:
    """Title of a set of effects, in words."""
    return " + ".join(effect_title(name) for name in explanation(names).split(" + "))


def effect_rows(findings: Mapping[str, Any], whole: str) -> list[dict[str, str]]:
    """Make a row for each parameter of what was found; `whole` is what an effect without a joint acts on."""
    return [
        {
            "title": item["title"] if number == 0 else "",
            "joint": (item["joint"] or whole) if number == 0 else "",
            "parameter": row.get("called", name).replace("_", " "),
            "value": f"{row['value']:.4g}",
            "interval": f"{row['interval90'][0]:.4g} to {row['interval90'][1]:.4g}",
            "unit": row["unit"] or "",
            "becomes": f"{row['was']:.3g} → {row['becomes']:.3g}" if "becomes" in row else "–",
        }
        for item in _told(findings)
        for number, (name, row) in enumerate(item["parameters"].items())
    ]


def _told(findings: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Effects with their parameters: those of the account, or of the best explanation where there is no account."""
    account = findings.get("account")
    return account["entries"] if account else findings["effects"]


def effect_notes(findings: Mapping[str, Any]) -> list[str]:
    """State for each effect what it is easily taken for, and how to tell them apart."""
    return [
        f"{item['title'].capitalize()} is easily taken for {', '.join(effect_title(n) for n in item['confused_with'])}. "
        f"To tell them apart: {item['tell_apart']}."
        for item in findings["effects"]
        if item["confused_with"]
    ]


def most(found: Mapping[str, Any], unit: str = "noise") -> str | None:
    """Describe the largest of a map's marked cells in words; None where nothing is marked.

    Args:
        found: Record of the map, as `ResidualMap.record` gives it.
        unit: Unit of the map's values, as findings state it.
    """
    values, marked = np.array(found["values"], dtype=float), np.array(found["marked"], dtype=bool)
    if not marked.any():
        return None
    columns = [(group, name) for group, names in found["groups"].items() for name in names]
    row, column = np.unravel_index(int(np.where(marked, values, -np.inf).argmax()), values.shape)
    group, name = columns[column]
    return f"{channel_name(found['channels'][row])}, {place(group, name)}: {amount(values[row, column], unit)}"


def unseen(findings: Mapping[str, Any]) -> str:
    """Name the data that nothing was fitted to: `throws` or `a record`."""
    return "throws" if "throws" in findings else "a record"


def remains(findings: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """State what is left unexplained.

    Args:
        findings: `findings.json`.
        after: Map of the residuals that remain on the record `select`.
    """
    where = most(after, findings["select"]["unit"])
    verdict = findings["verdict"]
    if verdict == "no_discrepancy" or (verdict == "not_enough_excitation" and findings["p_value"] >= Rules.alarm):
        return "Nothing beyond the noise."
    if not findings["effects"]:
        why = _UNFITTED.get(verdict, "no effect was fitted")
        return f"All of it: {why}." + (f" Most of it: {where}." if where else "")
    if not findings["something_remains"]:
        return f"Nothing beyond the noise ({p_sentence(findings['p_remaining'])})."
    left = f"More than noise ({p_sentence(findings['p_remaining'])})."
    return f"{left} Most of it: {where}." if where else f"{left} It is spread thinly: no cell of the map stands out."


def looks_like(findings: Mapping[str, Any], screening: Mapping[str, Any]) -> str:
    """State which known effects have signatures in these records much like those of the effects found; empty without any.

    Args:
        findings: `findings.json`.
        screening: `screen.json`.
    """
    out = []
    for item in findings["effects"]:
        name = f"{item['name']}:{item['joint']}" if item["joint"] else item["name"]
        near = [(set(row["pair"]) - {name}, row["cosine"]) for row in screening["signature_similarity"] if name in row["pair"]]
        listed = ", ".join(f"{effect_title(other)} ({cosine:.3f})" for others, cosine in near[:6] for other in others)
        title = effect_title(name)
        title = title[0].upper() + title[1:]
        out.append(f"{title} looks much like {listed}" if listed else f"{title} looks like no other known effect")
    if not out:
        return ""
    return "Before any fit (cosine of signatures): " + "; ".join(out) + "."


def next_steps(findings: Mapping[str, Any], about: Mapping[str, Any], screening: Mapping[str, Any], case: str) -> list[str]:
    """Advise what to do now, the most useful step first.

    Args:
        findings: `findings.json`.
        about: `records.json`.
        screening: `screen.json`.
        case: Name of the case.
    """
    verdict, out = findings["verdict"], []
    if verdict == "named" and findings["amended"]:
        out.append(f"Use results/gap/{case}/model.yaml instead of the model: it holds what was named, and the evidence.")
        out += advice(findings)
        if findings["something_remains"]:
            out.append(
                "Diagnose the amended model again with further records: something smaller is hidden behind what was named."
            )
    elif verdict == "named":
        out.append(
            "The name holds where it was chosen, but made a record worse: log another record of such motion and fit that one."
        )
    elif verdict == "ambiguous":
        out.append(_experiment(findings))
        out.append("Log one more record that way, name it 'select' in the case, and run again.")
    elif verdict == "none_of_the_known":
        if findings["amended"]:
            out.append(
                f"results/gap/{case}/model.yaml holds the effects of the account: likely, not proven, and nearer to what was "
                f"measured on {unseen(findings)} that they have not seen."
            )
        entries = (findings.get("account") or {"entries": []})["entries"]
        # One effect may act at several joints, and one experiment shows it at all of them.
        proofs = dict.fromkeys(
            f"To prove {item['title']}: {item['tell_apart']}; log that as a further record." for item in entries
        )
        out += list(proofs)[:_PROOFS]
        out.append(
            "Look at the map for what the motion has in common where the difference is largest: it may be an effect that no "
            "catalogue has (docs/gap.md, Adding an effect)."
        )
        if findings.get("suggestion"):
            out.append(f"A sparse regression of what remains suggests: {findings['suggestion']}.")
    elif verdict == "not_attributable":
        out.append("Throw it slowly, so that it touches once at one place: contacts of one kind can be told from each other.")
    elif verdict == "not_enough_excitation" and about["mode"] == "body":
        out.append("Throw it so that it hits, slides, tumbles and comes to rest: fast and slow, with spin, in all attitudes.")
    elif verdict == "not_enough_excitation":
        out.append("Log records of larger, faster and slower motion with reversals, over the whole range.")
    elif screening["unseen"]:
        hidden = ", ".join(effect_title(name) for name in screening["unseen"][:6])
        out.append(f"Nothing. These records could not show: {hidden}.")
    else:
        out.append("Nothing: every known effect of sensible size would have shown.")
    measured = about["records"]["fit"]["measured"]
    if "effort" not in measured and about["mode"] in ("pd", "position") and verdict != "no_discrepancy":
        out.append("Log the efforts too: a position controller hides dynamics from the positions.")
    return out


def advice(findings: Mapping[str, Any]) -> list[str]:
    """Advise what to do about effects that gsbridge's simulation cannot reproduce, one sentence for each."""
    return [item["instead"] for item in findings["effects"] if item.get("instead")]


def _experiment(findings: Mapping[str, Any]) -> str:
    """The experiment that tells the rivals of an ambiguous finding apart."""
    found = findings.get("experiment")
    if isinstance(found, Mapping) and found.get("sentence"):
        return str(found["sentence"])
    if isinstance(found, str):
        return found
    return f"To tell them apart: {findings['effects'][0]['tell_apart']}."
