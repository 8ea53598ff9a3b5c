"""Advice about a user's own JSON file fits the user, who must not be told to delete it."""

import pytest

from gsbridge.errors import InputError
from gsbridge.given import read_given_json


@pytest.mark.parametrize(
    ("text", "problem"),
    [(None, "does not exist"), ("{", "not valid JSON"), ("[1]", "holds no object"), (b"\xff", "not valid JSON")],
)
def test_the_remedy_is_the_given_one(tmp_path, text, problem):
    path = tmp_path / "transforms.json"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=problem) as told:
        read_given_json(path, "Export it again")
    assert told.value.remedy == "Export it again"
    assert told.value.source == str(path)


def test_what_can_be_read_is_returned(tmp_path):
    path = tmp_path / "a.json"
    path.write_text('{"w": 640}')
    assert read_given_json(path, "Export it again") == {"w": 640}
