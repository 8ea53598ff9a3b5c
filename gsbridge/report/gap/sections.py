"""What a gap report says and draws differently about a mechanism and about throws."""

from __future__ import annotations

import zipfile
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.diagnosis.wording import p_value, plain
from gsbridge.geometry import Array
from gsbridge.report.gap.figures import draw_channels, draw_each, draw_residuals, draw_throws

JUDGED = "verify"
"""The record whose residuals are shown: neither fitting nor choosing has seen it."""


def read_series(path: str | Path) -> dict[str, Array]:
    """Read the motion and the residuals that `replay_gap` wrote.

    Raises:
        InputError: The file is missing or damaged.
    """
    try:
        with np.load(path) as data:
            return {name: data[name] for name in data.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(path, f"the replays cannot be read ({error})", "Delete the file and run the rule again") from error


@dataclass(frozen=True)
class CaseSections(ABC):
    """Parts of the report that differ between kinds of cases.

    Args:
        about: What the page compares, in a sentence.
        logs: Plural noun for its measurements, such as `records`.
        short: Unit of the rivals' distances, empty for multiples of the noise.
        enough: Words on how far behind rivals must be, where that is one number; otherwise empty.
        whole: What an effect without a joint acts on.
        shares_note: How the account's shares are counted, where they differ from the figures at the top.
        map_caption: Caption of the map of residuals.
        rivals_note: Note below the table of rivals.
        noise_note: Note below the table of the noise.
    """

    about: str
    logs: str
    short: str
    enough: str
    whole: str
    shares_note: str
    map_caption: str
    rivals_note: str
    noise_note: str

    @abstractmethod
    def numbers(self, findings: Mapping[str, Any], judged: Mapping[str, Any], explained: bool) -> list[dict[str, str]]:
        """Make the figures at the top: gap before and after on the record `JUDGED`.

        Args:
            findings: Content of `findings.json`.
            judged: What `replays.json` says about the record `JUDGED`.
            explained: Whether an explanation was found, so that there are residuals after it.

        Returns:
            One item per figure, as the page's template takes it.
        """

    @abstractmethod
    def pictures(
        self,
        findings: Mapping[str, Any],
        series: Mapping[str, Array],
        judged: Mapping[str, Any],
        explained: bool,
        units: Mapping[str, str],
    ) -> dict[str, str]:
        """Draw the two figures that compare before and after.

        Args:
            findings: Content of `findings.json`.
            series: What `read_series` gave, by `{role}/{what}`. [...] each.
            judged: What `replays.json` says about the record `JUDGED`.
            explained: Whether an explanation was found, so that there are residuals after it.
            units: Unit of each kind of channel, or of a channel alone.

        Returns:
            The figures and their words, by the names that the page's template asks for.
        """


class MechanismSections(CaseSections):
    """Sections about records of a mechanism; gaps are multiples of the noise."""

    def numbers(self, findings: Mapping[str, Any], judged: Mapping[str, Any], explained: bool) -> list[dict[str, str]]:
        """Make the figures of the gap in multiples of the noise."""
        checked = findings["verify"]
        before = checked["before"] if checked else judged["before"]
        out = [_number(f"{plain(before)} ×", "the noise: gap before, on a record not fitted", "before")]
        if checked and explained:
            out.append(_number(f"{plain(checked['after'])} ×", f"the noise: gap {_adopted(findings)}", "after"))
            out.append(_number(f"{100 * checked['closure']:.0f} %", "of what stands above the noise is closed"))
        return [*out, _number(p_value(findings["p_value"]), "p: chance of such residuals without any gap")]

    def pictures(
        self,
        findings: Mapping[str, Any],
        series: Mapping[str, Array],
        judged: Mapping[str, Any],
        explained: bool,
        units: Mapping[str, str],
    ) -> dict[str, str]:
        """Draw residuals over time, and the residual of every channel."""
        pairs = _channel_pairs(series, judged["channels"])
        text = "Measured less simulated on the record verify, which neither fitting nor choosing has seen."
        if explained:
            text += f" Blue is {_model(findings)}: good residuals stay inside the grey band."
        else:
            text += " The grey band is noise."
        return {
            "residuals": draw_residuals(series, JUDGED, judged["channels"], units),
            "residuals_text": text,
            "residuals_alt": "residuals before and after over time",
            "channels": draw_channels(pairs, explained),
            "channels_alt": "residual of each channel before and after",
            "channels_text": "Every channel on the same record. Left of the dashed line there is nothing but noise."
            if len(pairs) <= 14
            else "The channels with the largest gap on the same record. At the dashed line there is nothing but noise.",
        }


class ThrowSections(CaseSections):
    """Sections about throws; gaps are in millimetres."""

    def numbers(self, findings: Mapping[str, Any], judged: Mapping[str, Any], explained: bool) -> list[dict[str, str]]:
        """Make the figures of the gap as mean distances, mm."""
        checked = findings["verify"]
        before = checked["before"] if checked else judged["before"]
        out = [_number(f"{before:.3g} mm", "mean distance before, on throws not fitted", "before")]
        if checked and explained:
            out.append(_number(f"{checked['after']:.3g} mm", f"mean distance {_adopted(findings)}", "after"))
            out.append(_number(f"{100 * checked['removed']:.0f} %", "of the distance is gone"))
        out.append(_number(f"{_floor(findings):.3g} mm", "is what noise and chaos explain"))
        return [*out, _number(p_value(findings["p_value"]), "p: chance of such distances without any gap")]

    def pictures(
        self,
        findings: Mapping[str, Any],
        series: Mapping[str, Array],
        judged: Mapping[str, Any],
        explained: bool,
        units: Mapping[str, str],
    ) -> dict[str, str]:
        """Draw distances over time with some paths, and the mean distance of every throw."""
        number, floor = series[f"{JUDGED}/throw"].astype(int), _floor(findings)
        sizes = [
            1e3 * np.bincount(number, weights=series[f"{JUDGED}/{when}"]) / np.bincount(number)
            for when in ("before", "after")[: 1 + explained]
        ]
        text = (
            "Simulated against measured position of the throws verify, which neither fitting nor choosing has seen. Lines are "
            "means over throws, bands hold eight of ten."
        )
        if explained:
            text += f" Blue is {_model(findings)}."
        return {
            "residuals": draw_throws(series, JUDGED, floor, judged["throws"]),
            "residuals_text": text,
            "residuals_alt": "distance over time before and after, and paths seen from above",
            "channels": draw_each(sizes[0], sizes[1] if explained else None, floor),
            "channels_alt": "mean distance of every throw before and after",
            "channels_text": f"Each of the {len(sizes[0])} throws. Contact is chaotic: some of them end elsewhere however good "
            "the model is.",
        }


MECHANISM = MechanismSections(
    about="The same commands went to a machine and to its simulation.",
    logs="records",
    short="",
    enough="; 9 would do",
    whole="whole mechanism",
    shares_note="",
    map_caption="Root mean square residual on the record select, in units of the noise (1 is noise alone), by channel and "
    "by what the joint does; + and − are its directions. Bold: noise alone does not explain it (of the bold cells, one in a "
    "hundred may be chance). Dots: too few samples.",
    rivals_note="Behind: squared residual more than the best one's, in units of the noise. The probability is one of "
    "likelihood, less sure by as much as blocks of time spread more than white noise.",
    noise_note="Gap: root mean square residual of the model as it was, in units of the noise.",
)
"""Sections of the report on any model with joints."""

THROWS = ThrowSections(
    about="The same throws were made in reality and in a simulation.",
    logs="throws",
    short="mm",
    enough="",
    whole="body and contact",
    shares_note="Each distance is divided here by how far noise and chaos alone carry a throw by that moment; the shares "
    "therefore differ from the figures at the top, which count plain distances.",
    map_caption="Root mean square distance on the throws select, in mm, along the axes of each throw, by phase (flight "
    "until the first touch, impact for 60 ms behind it, after) and by how the throw starts. Bold: noise and chaos do not "
    "explain it (of the bold cells, one in a hundred may be chance). Dots: too few throws.",
    rivals_note="Behind: mean distance more than the best one's. The probability is a bootstrap over throws.",
    noise_note="Gap: root mean square distance of the model as it was, in mm.",
)
"""Sections of the report on a thrown body."""


def _number(value: str, label: str, tone: str = "") -> dict[str, str]:
    return {"value": value, "label": label, "tone": tone}


def _adopted(findings: Mapping[str, Any]) -> str:
    return "after" if findings["amended"] else "with the best explanation"


def _model(findings: Mapping[str, Any]) -> str:
    return "the amended model" if findings["amended"] else "the best explanation"


def _floor(findings: Mapping[str, Any]) -> float:
    """Distance that noise and chaos alone explain, mm."""
    return 1e3 * float(findings["noise_floor"]["position"])


def _channel_pairs(series: Mapping[str, Array], channels: list[str]) -> dict[str, tuple[float, float]]:
    """Root mean square residual of each channel before and after, in units of the noise."""
    before = series[f"{JUDGED}/before"]
    after = series.get(f"{JUDGED}/after", before)
    sizes = [np.sqrt((values**2).mean(axis=0)) for values in (before, after)]
    return {name: (float(sizes[0][k]), float(sizes[1][k])) for k, name in enumerate(channels)}
