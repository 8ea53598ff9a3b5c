"""Threads of a scene's jobs."""

import pytest

from gsbridge.errors import InputError
from gsbridge.experiment.threads import VARIABLE, scene_threads


@pytest.mark.parametrize(("given", "threads"), [(None, 1), ("", 1), ("3", 3)])
def test_a_person_decides(given, threads, monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    if given is not None:
        monkeypatch.setenv(VARIABLE, given)
    assert scene_threads() == threads


@pytest.mark.parametrize("given", ["0", "many", "-1", "2.5", "\u0663", "9" * 5000])
def test_what_is_no_number_of_threads_is_refused(given, monkeypatch):
    monkeypatch.setenv(VARIABLE, given)
    with pytest.raises(InputError, match=rf"^the environment variable {VARIABLE}: .* is no number of threads\. Give"):
        scene_threads()
