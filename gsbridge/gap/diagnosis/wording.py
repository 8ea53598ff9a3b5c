"""Figures and places as text for a reader: `< 0.1 %` says as much to a person as 5.85e-225."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_LEAST = 0.001
"""Smallest probability that is printed as a number; smaller ones are printed as `<` this."""

_GROUPS = {
    "phase": "while the joint {}",
    "speed": "when it moves {}",
    "position": "in the {} third of its range",
    "load": "under {} load",
    "start speed": "in {} throws",
    "start spin": "in throws with {} spin",
}
"""How the columns of a residual map are said, by group."""

_PLACES = {
    "flight": "in flight",
    "impact": "at the first impact",
    "after": "behind the first impact",
    "at rest": "while the joint is at rest",
    "steady +": "at steady speed forwards",
    "steady −": "at steady speed backwards",
}
"""Columns that are said otherwise than their group."""


def percentage(probability: float) -> str:
    """Format a probability in percent: `37 %`, `< 0.1 %` or `> 99.9 %`."""
    if probability < _LEAST:
        return f"< {100 * _LEAST:g} %"
    if probability > 1.0 - _LEAST:
        return f"> {100 * (1.0 - _LEAST):g} %"
    return f"{100 * probability:.3g} %"


def p_value(p: float) -> str:
    """Format a p-value on its own: `0.013` or `< 0.001`."""
    return f"{p:.2g}" if p >= _LEAST else f"< {_LEAST:g}"


def p_sentence(p: float) -> str:
    """Format a p-value for use inside a sentence: `p = 0.013` or `p < 0.001`."""
    return f"p = {p:.2g}" if p >= _LEAST else f"p < {_LEAST:g}"


def channel_name(channel: str) -> str:
    """Title of a channel: `position of axis` for `position.axis`."""
    kind, _, joint = channel.partition(".")
    return f"{kind} of {joint}" if joint else kind


def plain(value: float) -> str:
    """Format a number with three digits; from 100 on without decimals and in groups of three digits."""
    return f"{value:,.0f}".replace(",", "\u202f") if value >= 100 else f"{value:.3g}"


def amount(value: float, unit: str) -> str:
    """Format the size of a residual: a multiple of the noise, or a length."""
    return f"{plain(value)} times the noise" if unit == "noise" else f"{plain(value)} {unit}"


def digits_of(interval: Sequence[float], scale: float = 1.0) -> tuple[float, int]:
    """Return half the width of an interval, and the decimals that show its second digit after it is multiplied by `scale`."""
    half = max(0.5 * (interval[1] - interval[0]), 1e-12)
    return half, max(0, int(1 - np.floor(np.log10(scale * half))))


def rounded(value: float, interval: Sequence[float]) -> str:
    """Format a value with half the width of its interval, both rounded to the second digit of that half width."""
    half, digits = digits_of(interval)
    return f"{value:.{digits}f} ± {half:.{digits}f}"


def place(group: str, name: str) -> str:
    """Say a column of a residual map as the end of a sentence: `slows down +` is "while the joint slows down forwards"."""
    words = _PLACES.get(name) or _GROUPS[group].format(name)
    return words.replace(" +", " forwards").replace(" −", " backwards")


__all__ = ["amount", "channel_name", "digits_of", "p_sentence", "p_value", "percentage", "place", "plain", "rounded"]
