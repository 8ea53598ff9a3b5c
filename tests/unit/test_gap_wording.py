"""Figures and places as pages show them: probabilities as a number where it is meaningful, else as less than a bound."""

import pytest

from gsbridge.gap.contact import residual_map as throw_map
from gsbridge.gap.diagnosis.wording import amount, p_sentence, p_value, percentage, place
from gsbridge.gap.joints import residual_map as joint_map


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


@pytest.mark.parametrize(
    ("value", "unit", "words"),
    [(0.51234, "mm", "0.512 mm"), (2.0, "noise", "2 times the noise"), (1442.99, "noise", "1\u202f443 times the noise")],
)
def test_large_amounts_have_no_powers_of_ten(value, unit, words):
    assert amount(value, unit) == words


@pytest.mark.parametrize("groups", [joint_map.GROUPS, throw_map.GROUPS])
def test_every_column_of_a_map_can_be_said(groups):
    said = [place(group, name) for group, names in groups.items() for name in names]
    assert len(set(said)) == len(said)
    assert not any(sign in words for words in said for sign in "+−")


def test_a_direction_is_said_in_words():
    assert place("phase", "slows down +") == "while the joint slows down forwards"
    assert place("phase", "steady −") == "at steady speed backwards"
