"""The report of a case of the gap: one HTML file that a person understands in a minute."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import atomic_file, read_json
from gsbridge.geometry import Array
from gsbridge.report.gap_figures import UNITS, channel_name, draw_channels, draw_residuals, draw_where
from gsbridge.report.gap_template import GAP_PAGE
from gsbridge.report.gap_words import LABELS, effect_title, explanation_title, looks_like, most, next_steps, remains

JUDGED = "verify"
"""The record whose residuals are shown: neither fitting nor choosing has seen it."""


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
    """Write the page.

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
    series = read_series(files.series)
    select, judged = replays["records"]["select"], replays["records"][JUDGED]
    explained = f"{JUDGED}/after" in series
    before_map = comparison["records"]["select"]["where"]
    pairs = _channel_pairs(series, judged["channels"])
    label, tone = LABELS[findings["verdict"]]
    environment = jinja2.Environment(autoescape=True, trim_blocks=False, undefined=jinja2.StrictUndefined)
    text = environment.from_string(GAP_PAGE).render(
        case=case,
        verdict=label,
        tone=tone,
        remaining=findings["something_remains"] and findings["verdict"] == "named",
        reasons=findings["reasons"],
        sentence=findings["sentence"],
        numbers=_numbers(findings, judged, explained),
        steps=next_steps(findings, about, screening, case),
        residuals=draw_residuals(series, JUDGED, judged["channels"]),
        residuals_text=_residuals_text(findings, explained),
        channels=draw_channels(pairs, explained),
        channels_text="Every channel on the same record. Left of the dashed line there is nothing but noise."
        if len(pairs) <= 14
        else "The channels with the largest gap on the same record. At the dashed line there is nothing but noise.",
        found_title="What was found" if findings["amended"] else "The best explanation, which was not adopted",
        effects=_effects(findings),
        effect_notes=_effect_notes(findings),
        where=draw_where(before_map, select["remains"] if explained else None),
        where_text=_where_text(before_map),
        rivals=_rivals(findings),
        rivals_text=_rivals_text(findings),
        remains_text=remains(findings, select["remains"]),
        alike=looks_like(findings, screening),
        unseen=", ".join(effect_title(name) for name in screening["unseen"]),
        roles=list(comparison["records"]),
        noise=_noise(comparison),
        records=_records(about),
        provenance=_provenance(findings, about, screening),
    )
    with atomic_file(out) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_series(path: str | Path) -> dict[str, Array]:
    """Motion and residuals that `replay_gap` left.

    Raises:
        InputError: The file is missing or damaged.
    """
    try:
        with np.load(path) as data:
            return {name: data[name] for name in data.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(path, f"the replays cannot be read ({error})", "Delete the file and run the rule again") from error


def _channel_pairs(series: Mapping[str, Array], channels: list[str]) -> dict[str, tuple[float, float]]:
    """Root mean square residual of each channel before and after."""
    before = series[f"{JUDGED}/before"]
    after = series.get(f"{JUDGED}/after", before)
    sizes = [np.sqrt((values**2).mean(axis=0)) for values in (before, after)]
    return {name: (float(sizes[0][k]), float(sizes[1][k])) for k, name in enumerate(channels)}


def _numbers(findings: Mapping[str, Any], judged: Mapping[str, Any], explained: bool) -> list[dict[str, str]]:
    """The figures at the top."""
    checked = findings["verify"]
    before = checked["before"] if checked else judged["before"]
    out = [{"value": f"{before:.3g} ×", "label": "the noise: gap before, on a record not fitted", "tone": "before"}]
    if checked and explained:
        adopted = "after" if findings["amended"] else "with the best explanation"
        out.append({"value": f"{checked['after']:.3g} ×", "label": f"the noise: gap {adopted}", "tone": "after"})
        out.append(
            {"value": f"{100 * checked['closure']:.0f} %", "label": "of what stands above the noise is closed", "tone": ""}
        )
    chance = findings["p_value"]
    out.append({"value": f"{chance:.2g}", "label": "p: chance of such residuals without any gap", "tone": ""})
    return out


def _residuals_text(findings: Mapping[str, Any], explained: bool) -> str:
    """What the first figure shows."""
    what = "Measured less simulated on the record verify, which neither fitting nor choosing has seen."
    if not explained:
        return f"{what} The grey band is noise."
    after = "the amended model" if findings["amended"] else "the best explanation"
    return f"{what} Blue is {after}: good residuals stay inside the grey band."


def _effects(findings: Mapping[str, Any]) -> list[dict[str, str]]:
    """Parameters of what was found, one row each."""
    return [
        {
            "title": item["title"] if number == 0 else "",
            "joint": (item["joint"] or "whole mechanism") if number == 0 else "",
            "parameter": name.replace("_", " "),
            "value": f"{row['value']:.4g}",
            "interval": f"{row['interval90'][0]:.4g} to {row['interval90'][1]:.4g}",
            "unit": row["unit"] or "–",
        }
        for item in findings["effects"]
        for number, (name, row) in enumerate(item["parameters"].items())
    ]


def _effect_notes(findings: Mapping[str, Any]) -> list[str]:
    """How each effect could be confirmed."""
    return [
        f"{item['title'].capitalize()} is easily taken for {', '.join(effect_title(n) for n in item['confused_with'])}. "
        f"To tell them apart: {item['tell_apart']}."
        for item in findings["effects"]
        if item["confused_with"]
    ]


def _where_text(found: Mapping[str, Any]) -> str:
    """The darkest cell in words."""
    place = most(found)
    return f"Most of all in the {place}." if place else "Nowhere more than noise would."


def _rivals(findings: Mapping[str, Any], count: int = 8) -> list[dict[str, str]]:
    """Explanations, the best first."""
    return [
        {
            "title": explanation_title(row["effects"]),
            "share": f"{100 * min(max(row['closure'], 0.0), 1.0):.1f}",
            "closure": f"{100 * row['closure']:.0f} %" if row["closure"] > 0 else "none",
            "behind": "–" if number == 0 else _count(row["behind"]),
            "probability": f"{100 * row['probability']:.3g} %",
        }
        for number, row in enumerate(findings["rivals"][:count])
    ]


def _rivals_text(findings: Mapping[str, Any]) -> str:
    """How clear the race is."""
    if findings["verdict"] == "ambiguous":
        names = " and ".join(explanation_title(item) for item in findings["ambiguous"])
        return f"The records cannot decide among {names}."
    if findings["verdict"] == "none_of_the_known":
        return "None of them explains the data well enough to be named."
    if len(findings["rivals"]) > 1:
        second = findings["rivals"][1]
        return f"The next best, {explanation_title(second['effects'])}, is {_count(second['behind'])} behind; 9 would do."
    return "There is no other that came near."


def _count(value: float) -> str:
    """A large number for people."""
    return f"{value:,.0f}".replace(",", "\u202f") if value >= 100 else f"{value:.3g}"


def _noise(comparison: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Noise and gap of each channel."""
    records = comparison["records"]
    return [
        {
            "channel": channel_name(name),
            "sigma": f"{sigma:.3g}",
            "unit": UNITS.get(name.split(".")[0], ""),
            "gaps": [f"{item['channels'][name]:.3g}" if name in item["channels"] else "–" for item in records.values()],
        }
        for name, sigma in records["select"]["noise"].items()
    ]


def _records(about: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The records that were used."""
    return [
        {
            "name": item["name"],
            "role": role,
            "seconds": f"{item['seconds']:.3g}",
            "samples": item["samples"],
            "rate": f"{item['rate_hz']:.4g}",
            "channels": ", ".join((*item["commands"], *item["measured"])),
            "digest": item["digest"],
        }
        for role, item in about["records"].items()
    ]


def _joints(names: list[str]) -> str:
    """How many joints."""
    return "1 joint" if len(names) == 1 else f"{len(names)} joints"


def _provenance(findings: Mapping[str, Any], about: Mapping[str, Any], screening: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Where the figures come from."""
    runs = findings["simulations"]
    return [
        ("model", f"{Path(about['model']).name}, SHA-256 {about['model_digest']}"),
        (
            "mechanism and controller",
            f"{_joints(about['joints'])}, mode {about['mode']}, SHA-256 {about['mechanism_digest']}",
        ),
        ("candidates", f"{len(screening['candidates'])} effects and joints, {screening['signatures']} signatures"),
        ("simulations", f"{runs['case']} for this case after a bank of {runs['bank']}"),
        ("seconds", f"{findings['seconds']:.1f}"),
        ("seed", str(findings["seed"])),
        ("version", f"gsbridge {about['versions']['gsbridge']}"),
    ]
