"""The report on photos of two days: one HTML file that a person understands in a minute."""

# ruff: noqa: E501  (markup)

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2
import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from gsbridge.environment.lens import UNDRAWN
from gsbridge.errors import InputError
from gsbridge.files import atomic_file, read_json
from gsbridge.geometry import Array
from gsbridge.report.gap.figures import data_uri
from gsbridge.report.gap.page import effect_notes, effect_rows
from gsbridge.report.gap.template import gap_page
from gsbridge.report.gap.text import head, plain

_FULL = 6.0
"""Deviations that are drawn as white."""

_TITLES = ("earlier photo", "later photo", "as expected", "apart before", "apart after")

_PAGE = gap_page(
    "gsbridge: photos of {{ case }}",
    "Photos of <b>{{ case }}</b>: what changed since the first day",
    """\
<h2 id="pictures">Before and after</h2>
<p>Views that neither fitting nor choosing has seen. Grey is what is apart, in units of the noise, white at {{ full }} times it; black where nothing is compared: at edges of things, where other things may come into sight.</p>
<figure class="picture"><img src="{{ picture }}" alt="photos before, after, as expected, and what is apart"></figure>
{% if effects %}
<h2 id="found">{{ found_title }}</h2>
<div class="scroll"><table>
<thead><tr><th>effect</th><th class="text">parameter</th><th>value</th><th>90 % interval</th><th class="text">unit</th></tr></thead>
<tbody>
{% for row in effects %}<tr><td><b>{{ row.title }}</b></td><td class="text">{{ row.parameter }}</td><td>{{ row.value }}</td><td>{{ row.interval }}</td><td class="text">{{ row.unit }}</td></tr>
{% endfor %}</tbody></table></div>
{% for note in notes %}<p class="note">{{ note }}</p>
{% endfor %}
{% endif %}
{% if rivals %}
<h2 id="rivals">The rivals</h2>
<div class="scroll"><table>
<thead><tr><th>explanation</th><th class="text">share of the gap closed</th><th></th><th>behind the best</th><th>probability</th></tr></thead>
<tbody>
{% for row in rivals %}<tr><td class="text">{% if loop.first %}<b>{{ row.title }}</b>{% else %}{{ row.title }}{% endif %}</td><td class="barcell"><span class="bar" style="width: {{ row.share }}%"></span></td><td>{{ row.closure }}</td><td>{{ row.behind }}</td><td>{{ row.probability }}</td></tr>
{% endfor %}</tbody></table></div>
<p class="note">Fitted to some views and judged on others; distances are of minus twice the logarithm of the likelihood.</p>
{% endif %}
{% if unseen %}
<p class="note">Could not show in these photos at any sensible size: {{ unseen }}.</p>
{% endif %}
<h2 id="provenance">Provenance</h2>
<dl>
{% for name, value in provenance %}<dt>{{ name }}</dt><dd>{{ value }}</dd>
{% endfor %}</dl>
<p class="note">For machines: <code>findings.json</code> beside this page.</p>
</body>
</html>
""",
)


def write_sight_report(case: str, findings: str | Path, pictures: str | Path, out: str | Path) -> None:
    """Write the page.

    Args:
        case: Name of the changed world.
        findings: `findings.json`.
        pictures: `pictures.npz` beside it.
        out: The HTML file.

    Raises:
        InputError: A file is missing or damaged.
    """
    found, shown = read_json(findings), _read(pictures)
    environment = jinja2.Environment(autoescape=True, trim_blocks=False, undefined=jinja2.StrictUndefined)
    text = environment.from_string(_PAGE).render(
        case=case,
        **head(found),
        numbers=_numbers(found),
        steps=_steps(found),
        full=f"{_FULL:g}",
        picture=_draw(shown, bool(found["effects"])),
        found_title="What was found" if found["amended"] else "The best explanation, which was not adopted",
        effects=effect_rows(found, ""),
        notes=effect_notes(found),
        rivals=_rivals(found),
        unseen=", ".join(name.replace("_", " ") for name in found["unseen"]),
        provenance=_provenance(found),
    )
    with atomic_file(out) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _read(path: str | Path) -> dict[str, Array]:
    try:
        with np.load(path) as data:
            return {name: data[name] for name in ("before", "after", "expected", "compared", "gap", "left")}
    except (EOFError, KeyError, OSError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(path, f"the pictures cannot be read ({error})", "Delete the file and run the rule again") from error


def _numbers(found: Mapping[str, Any]) -> list[dict[str, str]]:
    """Gap before and after, share closed, chance."""
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
    chance = f"{found['p_value']:.2g}"
    return [*out, {"value": chance, "label": "p: chance of such photos if nothing had changed", "tone": ""}]


def _steps(found: Mapping[str, Any]) -> list[str]:
    """What to do now."""
    verdict = found["verdict"]
    if verdict == "named":
        names = {item["name"] for item in found["effects"]}
        learnt = "." if names & set(UNDRAWN) else ", or let the policy learn with the amended model."
        moved = (
            ["The camera sits or looks otherwise than it was registered: register it again."] if "extrinsics" in names else []
        )
        return [f"Mend the camera{learnt}", *moved]
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
            "probability": f"{100 * row['probability']:.3g} %",
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


def _draw(shown: Mapping[str, Array], explained: bool) -> str:
    """Photos of some views, a row each, and what is apart. A data URI."""
    maps = [np.where(shown["compared"] > 0, shown[name] / _FULL, 0.0) for name in ("gap", "left")]
    columns = [shown["before"], shown["after"], shown["expected"], *maps]
    columns = columns if explained else [columns[0], columns[1], columns[3]]
    titles = _TITLES if explained else (_TITLES[0], _TITLES[1], _TITLES[3])
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
