"""Probabilities as pages show them: as a number where it is meaningful, else as less than a bound."""

import pytest

from gsbridge.gap.diagnosis.chances import p_sentence, p_value, percentage


@pytest.mark.parametrize(
    ("probability", "words"),
    [
        (0.0, "< 0.1 %"),
        (5.85e-227, "< 0.1 %"),
        (0.000999, "< 0.1 %"),
        (0.001, "0.1 %"),
        (0.0213, "2.13 %"),
        (0.37, "37 %"),
        (0.9987, "99.9 %"),
        (0.99999, "> 99.9 %"),
        (1.0, "> 99.9 %"),
    ],
)
def test_percentages_have_a_readable_size(probability, words):
    assert percentage(probability) == words


@pytest.mark.parametrize(("p", "words"), [(1e-6, "< 0.001"), (0.001, "0.001"), (0.0132, "0.013"), (1.0, "1")])
def test_a_p_value_stands_alone_or_in_a_sentence(p, words):
    assert p_value(p) == words
    assert p_sentence(p) == (f"p {words}" if words.startswith("<") else f"p = {words}")
