"""Probabilities as text for a reader: `< 0.1 %` says as much to a person as 5.85e-225."""

from __future__ import annotations

_LEAST = 0.001
"""Smallest probability that is printed as a number; smaller ones are printed as `<` this."""


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


__all__ = ["p_sentence", "p_value", "percentage"]
