"""Whatever is wrong with a case's or a model's file is told in one line."""

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.gap.formats.yaml_file import plain_number, read_yaml


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"model: [a, b\nrecords: 1\n", r"line \d+, column \d+"),
        (b"model: a\nmodel: b\n", "model"),
        (b"model: \xff", "not valid YAML"),
        (None, "the case cannot be read"),
    ],
)
def test_each_fault_is_one_line(tmp_path, content, said):
    path = tmp_path / "case.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=said) as caught:
        read_yaml(path, "case", "docs/gap.md")
    assert "\n" not in caught.value.problem


@pytest.mark.parametrize(
    ("value", "number"),
    [("5e-4", 5e-4), (".5e3", 500.0), ("inf", np.inf), ("60", 60.0), (np.float32(2.0), 2.0), (np.int64(3), 3.0)],
)
def test_what_stands_for_a_number_is_one(value, number):
    assert plain_number(value) == number


@pytest.mark.parametrize("value", ["060", "1_0", "a", "nan", "", None, True, np.bool_(True), [1.0]])
def test_what_may_stand_for_another_number_is_none(value):
    assert plain_number(value) is None


def test_times_of_the_day_are_text(tmp_path):
    (tmp_path / "case.yaml").write_text("model: 09:30\n")
    assert read_yaml(tmp_path / "case.yaml", "case", "docs/gap.md") == {"model": "09:30"}


def test_content_comes_back(tmp_path):
    (tmp_path / "case.yaml").write_text("model: model.yaml\nrecords: {fit: a.csv}\n")
    assert read_yaml(tmp_path / "case.yaml", "case", "docs/gap.md") == {"model": "model.yaml", "records": {"fit": "a.csv"}}
