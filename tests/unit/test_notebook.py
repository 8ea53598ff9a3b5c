"""A notebook gives back what it was told, and never stands in the way."""

import json

import pytest

from gsbridge import notebook
from gsbridge.notebook import Notebook, cache_root


def test_the_next_process_looks_up_what_this_one_worked_out(tmp_path):
    path = tmp_path / "facts" / "facts.json"
    first = Notebook(path)
    assert first.look_up("a", lambda: [1, "one"]) == [1, "one"]
    assert not path.exists()
    first.save()
    second = Notebook(path)
    assert second.look_up("a", lambda: pytest.fail("it is known")) == [1, "one"]
    assert second.look_up("b", lambda: 2) == 2
    second.save()
    assert json.loads(path.read_text()) == {"a": [1, "one"], "b": 2}
    assert [entry.name for entry in path.parent.iterdir()] == ["facts.json"]


@pytest.mark.parametrize("text", ["", "{", "[1]", "\x00"])
def test_a_broken_file_is_written_anew(tmp_path, text):
    path = tmp_path / "facts.json"
    path.write_text(text)
    book = Notebook(path)
    assert book.look_up("a", lambda: 1) == 1
    book.save()
    assert json.loads(path.read_text()) == {"a": 1}


def test_what_cannot_be_written_is_passed_over(tmp_path):
    (tmp_path / "file").write_text("")
    book = Notebook(tmp_path / "file" / "facts.json")
    assert book.look_up("a", lambda: 1) == 1
    book.save()


def test_a_full_notebook_starts_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(notebook, "MOST", 2)
    path = tmp_path / "facts.json"
    path.write_text('{"a": 1, "b": 2}')
    book = Notebook(path)
    book.look_up("c", lambda: 3)
    book.save()
    assert json.loads(path.read_text()) == {"c": 3}


def test_the_cache_lies_where_the_user_says(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_root() == tmp_path / "gsbridge"
