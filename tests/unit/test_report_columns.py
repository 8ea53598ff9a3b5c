"""The lists of columns in docs/tables.md are those that the code writes, with a meaning each."""

import re
from pathlib import Path

import pytest

from gsbridge.errors import InputError
from gsbridge.report.tables.columns import MEANINGS, TABLES, filled

PAGE = (Path(__file__).resolve().parents[2] / "docs/tables.md").read_text(encoding="utf-8")


def test_every_column_means_something_and_nothing_else_is_explained():
    assert {column for columns in TABLES.values() for column in columns} == set(MEANINGS)


def test_the_page_is_as_it_is_made():
    assert filled(PAGE) == PAGE, "run make schema"
    assert re.findall(r"<!-- columns: (\w+) -->", PAGE) == ["success", "failures", "training", "rendering", "timing"]


def test_an_unknown_table_is_refused():
    with pytest.raises(InputError, match="no table 'speed'"):
        filled("<!-- columns: speed -->\n<!-- end -->\n")
