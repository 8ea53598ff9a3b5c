"""The report on photos of two days: one HTML file that a person understands in a minute."""

# ruff: noqa: E501  (markup)

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.gap.diagnosis.wording import p_value, percentage, plain
from gsbridge.geometry import Array
from gsbridge.report.gap.figures import data_uri
from gsbridge.report.gap.text import advice, effect_notes, effect_rows, head
from gsbridge.report.pages.html import write_page

_FULL = 6.0
"""Deviation that is drawn as white, in units of the noise."""

_TITLES = ("earlier photo", "later photo", "as expected", "apart before", "apart after")
_DRAWN = ("as drawn, corrected", "photo", "as expected", "apart before", "apart after")
"""Titles of the columns where photos are compared with drawn pictures."""


def write_picture_report(case: str, findings: str | Path, pictures: str | Path, out: str | Path) -> None:
    """Write the page.

    Args:
        case: Name of the changed world, or of the case.
        findings: `findings.json`.
        pictures: `pictures.npz` beside it, or `replays.npz` of a case.
        out: The HTML file.

    Raises:
        InputError: A file is missing or damaged.
    """
    found, shown = read_json(findings), _read(pictures)
    write_page(
        out,
        "pictures.html.j2",
        case=case,
        **head(found),
        numbers=_numbers(found),
        steps=_steps(found),
        full=f"{_FULL:g}",
        picture=_draw(shown, bool(found["effects"]), _DRAWN if _is_drawn(found) else _TITLES),
        drawn=_is_drawn(found),
        lack=_lack(found),
        found_title="What was found" if found["amended"] else "The best explanation, which was not adopted",
        effects=effect_rows(found, ""),
        notes=effect_notes(found),
        rivals=_rivals(found),
        unseen=", ".join(name.replace("_", " ") for name in found["unseen"]),
        provenance=_provenance(found),
    )


def _is_drawn(found: Mapping[str, Any]) -> bool:
    """Whether photos were compared with drawn pictures."""
    return "model_error" in found


def _lack(found: Mapping[str, Any]) -> str:
    """State how far drawn pictures differ from photos; empty text where photos were compared with photos."""
    if not _is_drawn(found):
        return ""
    rms = {name: f"{100 * value:.1f} %" for name, value in found["model_error"]["rms"].items()}
    return (
        f"On the day of the registration, photos differ from drawn pictures by {rms['drawn']} (rms, of white); by"
        f" {rms['calibrated']} once the camera is calibrated, and by {rms['corrected']} once what is left elsewhere is added."
    )


def _read(path: str | Path) -> dict[str, Array]:
    try:
        with np.load(path) as data:
            return {name: data[name] for name in ("before", "after", "expected", "compared", "gap", "left")}
    except (EOFError, KeyError, OSError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(path, f"the pictures cannot be read ({error})", "Delete the file and run the rule again") from error


def _numbers(found: Mapping[str, Any]) -> list[dict[str, str]]:
    """Make the figures at the top: gap before and after, share closed, p-value."""
    checked = found["verify"]
    before = checked["before"] if checked else found["select"]["before"]
    where = "on views not fitted" if checked else "on the views of select"
    out = [{"value": f"{plain(before)} ×", "label": f"the noise: gap before, {where}", "tone": "before"}]
    if checked:
        word = "after" if found["amended"] else "with the best explanation, which was not adopted"
        out.append({"value": f"{plain(checked['after'])} ×", "label": f"the noise: gap {word}", "tone": "after"})
        out.append(
            {"value": f"{100 * checked['closure']:.0f} %", "label": "of what stands above the noise is closed", "tone": ""}
        )
    return [*out, {"value": p_value(found["p_value"]), "label": "p: chance of such photos if nothing had changed", "tone": ""}]


def _steps(found: Mapping[str, Any]) -> list[str]:
    """Advise what to do now, by verdict."""
    verdict = found["verdict"]
    if verdict == "named":
        names = {item["name"] for item in found["effects"]}
        learnt = "." if advice(found) else ", or let the policy learn with the amended model."
        moved = (
            ["The camera sits or looks otherwise than it was registered: register it again."] if "extrinsics" in names else []
        )
        return [f"Mend the camera{learnt}", *advice(found), *moved]
    if verdict == "ambiguous":
        return [f"To tell them apart: {found['effects'][0]['tell_apart']}."]
    if verdict == "none_of_the_known":
        return [
            "Look at what is apart: is it fixed to the image, to things, or to the light? If you know it, write it as an effect (docs/gap_images.md)."
        ]
    if verdict == "not_enough_excitation":
        return ["Photograph edges and colours, near and far, dark and bright."]
    return ["Nothing: photos of both days agree. If policies fail all the same, compare the motion (docs/gap.md)."]


def _rivals(found: Mapping[str, Any], count: int = 8) -> list[dict[str, str]]:
    return [
        {
            "title": " + ".join(name.replace("_", " ") for name in row["effects"]),
            "share": f"{100 * min(max(row['closure'], 0.0), 1.0):.1f}",
            "closure": f"{100 * row['closure']:.0f} %" if row["closure"] > 0 else "none",
            "behind": "–" if number == 0 else plain(row["behind"]),
            "probability": percentage(row["probability"]),
        }
        for number, row in enumerate(found["rivals"][:count])
    ]


def _provenance(found: Mapping[str, Any]) -> list[tuple[str, str]]:
    views = ", ".join(f"{role} {item['views']}" for role, item in found["photos"].items())
    repeats = next(iter(found["photos"].values()))["repeats"]
    return [
        ("views", f"{views}; {repeats} further photos of each on the first day"),
        ("expected photos", f"{found['simulations']['case']} sets"),
        (
            "noise of a pixel as compared",
            ", ".join(f"{value * 255:.2g}/255 ({name})" for name, value in found["noise_floor"].items()),
        ),
        *((f"photos {role}", digest) for role, digest in found["records"].items()),
        ("seconds", f"{found['seconds']:.1f}"),
        ("seed", str(found["seed"])),
    ]


def _draw(shown: Mapping[str, Array], explained: bool, names: Sequence[str]) -> str:
    """Draw photos of some views, a row each, beside maps of their deviations, as a data URI.

    Args:
        shown: Pictures, as `_read` gives them.
        explained: Whether an effect was fitted.
        names: Titles of the columns.
    """
    maps = [np.where(shown["compared"] > 0, shown[name] / _FULL, 0.0) for name in ("gap", "left")]
    columns = [shown["before"], shown["after"], shown["expected"], *maps]
    columns = columns if explained else [columns[0], columns[1], columns[3]]
    titles = names if explained else (names[0], names[1], names[3])
    rows = len(shown["before"])
    figure, axes = plt.subplots(
        rows, len(columns), figsize=(2.3 * len(columns), 2.35 * rows + 0.2), squeeze=False, layout="constrained"
    )
    for row in range(rows):
        for axis, column, title in zip(axes[row], columns, titles, strict=True):
            axis.imshow(np.clip(column[row], 0.0, 1.0), cmap="gray", vmin=0.0, vmax=1.0, interpolation="nearest")
            axis.set_axis_off()
            if row == 0:
                axis.set_title(title, fontsize=11)
    return data_uri(figure)
