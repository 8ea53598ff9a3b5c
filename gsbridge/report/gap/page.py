"""The report of a case of the gap: one HTML file that a person understands in a minute."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsbridge.files import read_json
from gsbridge.gap.diagnosis.wording import amount, channel_name, percentage, plain
from gsbridge.gap.image.case import PHOTOS
from gsbridge.report.gap.figures import channel_units, draw_residual_map
from gsbridge.report.gap.picture_page import write_picture_report
from gsbridge.report.gap.sections import JUDGED, MECHANISM, THROWS, CaseSections, read_series
from gsbridge.report.gap.text import (
    effect_notes,
    effect_rows,
    effect_title,
    explanation_title,
    head,
    looks_like,
    most,
    next_steps,
    remains,
    unseen,
)
from gsbridge.report.pages.html import write_page


@dataclass(frozen=True)
class CaseFiles:
    """Files of a case, as the stages left them.

    Args:
        record: `records.json`.
        comparison: `comparison.json`.
        screening: `screen.json`.
        findings: `findings.json`.
        series: `replays.npz`.
        replays: `replays.json`.
    """

    record: str | Path
    comparison: str | Path
    screening: str | Path
    findings: str | Path
    series: str | Path
    replays: str | Path


def write_gap_report(case: str, files: CaseFiles, out: str | Path) -> None:
    """Write the page of a case; a case of pictures gets the page of `gsbridge.report.gap.picture_page`.

    Args:
        case: Name of the case.
        files: What the stages left.
        out: The HTML file.

    Raises:
        InputError: A file is missing or damaged.
    """
    about, comparison, screening, findings, replays = map(
        read_json, (files.record, files.comparison, files.screening, files.findings, files.replays)
    )
    if about["mode"] == PHOTOS:
        write_picture_report(case, files.findings, files.series, out)
        return
    series = read_series(files.series)
    select, explained = replays["records"]["select"], f"{JUDGED}/after" in series
    before_map = comparison["records"]["select"]["residual_map"]
    parts = THROWS if about["mode"] == "body" else MECHANISM
    write_page(
        out,
        "gap.html.j2",
        case=case,
        compared=parts.about,
        **head(findings),
        numbers=parts.numbers(findings, replays["records"][JUDGED], explained),
        steps=next_steps(findings, about, screening, case),
        **parts.pictures(findings, series, replays["records"][JUDGED], explained, channel_units(about)),
        found_title="What was found" if findings["amended"] else "The best explanation, which was not adopted",
        effects=effect_rows(findings, parts.whole),
        account=account_rows(findings, parts.whole),
        account_text=_account_text(findings, parts),
        warnings=findings.get("warnings", []),
        becomes=any("becomes" in row for item in findings["effects"] for row in item["parameters"].values()),
        effect_notes=effect_notes(findings),
        residual_map=draw_residual_map(before_map, select["remains"] if explained else None),
        where_text=_residual_map_text(before_map, findings["select"]["unit"]),
        map_caption=parts.map_caption,
        rivals=_rivals(findings, parts.short),
        rivals_text=_rivals_text(findings, parts),
        rivals_note=parts.rivals_note,
        remains_text=remains(findings, select["remains"]),
        similar=looks_like(findings, screening),
        unseen=", ".join(effect_title(name) for name in screening["unseen"]),
        logs=parts.logs,
        roles=list(comparison["records"]),
        noise=_noise(comparison, about),
        noise_note=parts.noise_note,
        records=_records(about),
        provenance=_provenance(findings, about, screening),
    )


def account_rows(findings: Mapping[str, Any], whole: str) -> list[dict[str, str]]:
    """Make the lines of the account, largest share first; `whole` is what an effect without a joint acts on."""
    return [
        {
            "title": entry["title"],
            "joint": entry["joint"] or whole,
            "share": f"{100 * entry['share']:.1f} %",
            "width": f"{100 * min(max(entry['share'], 0.0), 1.0):.1f}",
            "verdict": entry["verdict"],
            "instead": ", ".join(explanation_title(name.split(" + ")) for name in entry["alternatives"]) or "–",
        }
        for entry in (findings.get("account") or {"entries": []})["entries"]
    ]


def _account_text(findings: Mapping[str, Any], parts: CaseSections) -> str:
    """State how much of the gap the account explains, how its shares are counted, and where most of the rest lies."""
    account = findings.get("account")
    if not account:
        return ""
    alone = len(account["entries"]) == 1
    what, each = ("It closes", "") if alone else ("Together they close", "Each share is what an effect adds to those above it.")
    left = account["remains"]
    rest = f"Most of the rest: {channel_name(left['channel'])}, {left['phase']}: {amount(left['size'], left['unit'])}."
    seen = f"{unseen(findings)} that neither fitting nor choosing has seen"
    told = f"{what} {100 * account['explained']:.0f} % of the gap on {seen}."
    return " ".join(text for text in (told, each, parts.shares_note, rest if left["channel"] else "") if text)


def _residual_map_text(found: Mapping[str, Any], unit: str) -> str:
    """Describe the cell of the map with the largest residual that noise does not explain."""
    place = most(found, unit)
    return f"Most of all: {place}." if place else "Nowhere more than noise would."


def _rivals(findings: Mapping[str, Any], short: str, count: int = 8) -> list[dict[str, str]]:
    """Make the rows of the table of explanations, the best first."""
    return [
        {
            "title": explanation_title(row["effects"]),
            "share": f"{100 * min(max(row['closure'], 0.0), 1.0):.1f}",
            "closure": f"{100 * row['closure']:.0f} %" if row["closure"] > 0 else "none",
            "behind": "–" if number == 0 else f"{plain(row['behind'])} {short}".rstrip(),
            "probability": percentage(row["probability"]),
        }
        for number, row in enumerate(findings["rivals"][:count])
    ]


def _rivals_text(findings: Mapping[str, Any], parts: CaseSections) -> str:
    """State how clearly the best explanation leads the others."""
    text = f"Explanations that were fitted to one set of {parts.logs} and judged on another."
    if findings["verdict"] == "ambiguous":
        names = " and ".join(explanation_title(item) for item in findings["ambiguous"])
        return f"{text} The {parts.logs} cannot decide among {names}."
    if findings["verdict"] == "none_of_the_known":
        return f"{text} None of them explains the data well enough to be named."
    if len(findings["rivals"]) > 1:
        second = findings["rivals"][1]
        behind = f"{plain(second['behind'])} {parts.short}".rstrip()
        return f"{text} The next best, {explanation_title(second['effects'])}, is {behind} behind{parts.enough}."
    return f"{text} There is no other that came near."


def _noise(comparison: Mapping[str, Any], about: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Make the rows of the table of noise and gap by channel."""
    records, units = comparison["records"], channel_units(about)
    return [
        {
            "channel": channel_name(name),
            "sigma": f"{sigma:.3g}",
            "unit": units.get(name, units.get(name.split(".")[0], "m")),
            "gaps": [f"{item['channels'][name]:.3g}" if name in item["channels"] else "–" for item in records.values()],
        }
        for name, sigma in records["select"]["noise"].items()
    ]


def _records(about: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Make the rows of the table of records."""
    return [
        {
            "name": item["name"],
            "role": f"{role}, {item['throws']} throws" if "throws" in item else role,
            "seconds": f"{item['seconds']:.3g}",
            "samples": item["samples"],
            "rate": f"{item['rate_hz']:.4g}",
            "channels": ", ".join((*item["commands"], *item["measured"])),
            "digest": item["digest"],
        }
        for role, item in about["records"].items()
    ]


def _joints(names: list[str]) -> str:
    """State the number of joints; empty text where there is none."""
    return "" if not names else "1 joint, " if len(names) == 1 else f"{len(names)} joints, "


def _provenance(findings: Mapping[str, Any], about: Mapping[str, Any], screening: Mapping[str, Any]) -> list[tuple[str, str]]:
    """List what the page's figures were made from: files, versions, seed and effort."""
    runs = findings["simulations"]
    return [
        ("model", f"{Path(about['model']).name}, SHA-256 {about['model_digest']}"),
        (
            "mechanism and controller" if about["joints"] else "body and contact",
            f"{_joints(about['joints'])}mode {about['mode']}, SHA-256 {about['mechanism_digest']}",
        ),
        (
            "candidates",
            f"{len(screening['candidates'])} effects{' and joints' if about['joints'] else ''}, "
            f"{screening['signatures']} signatures",
        ),
        ("simulations", f"{runs['case']} to name it after a bank of {runs['bank']}; {runs.get('account', 0)} for the account"),
        ("seconds", f"{findings['seconds']:.1f}"),
        ("seed", str(findings["seed"])),
        ("version", f"gsbridge {about['versions']['gsbridge']}"),
    ]
