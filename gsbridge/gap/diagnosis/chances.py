"""Probabilities in words: a person learns nothing from 5.85e-225 that `< 0.1 %` does not say."""

from __future__ import annotations

_LEAST = 0.001
"""Smallest probability that is told with its size."""


def percentage(probability: float) -> str:
    """A probability in percent: `37 %`, `< 0.1 %`, and `> 99.9 %` for what is all but sure."""
    if probability < _LEAST:
        return f"< {100 * _LEAST:g} %"
    if probability > 1.0 - _LEAST:
        return f"> {100 * (1.0 - _LEAST):g} %"
    return f"{100 * probability:.3g} %"


def p_value(p: float) -> str:
    """A p-value alone: `0.013` or `< 0.001`."""
    return f"{p:.2g}" if p >= _LEAST else f"< {_LEAST:g}"


def p_sentence(p: float) -> str:
    """A p-value inside a sentence: `p = 0.013` or `p < 0.001`."""
    return f"p = {p:.2g}" if p >= _LEAST else f"p < {_LEAST:g}"


__all__ = ["p_sentence", "p_value", "percentage"]
