"""Whatever is wrong with a case's or a model's file is told in one line."""

import pytest

from gsbridge.errors import InputError
from gsbridge.gap.formats.yaml_file import read_yaml


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


def test_content_comes_back(tmp_path):
    (tmp_path / "case.yaml").write_text("model: model.yaml\nrecords: {fit: a.csv}\n")
    assert read_yaml(tmp_path / "case.yaml", "case", "docs/gap.md") == {"model": "model.yaml", "records": {"fit": "a.csv"}}
