"""Threads of a scene's jobs."""

import pytest

from gsbridge.experiment.threads import VARIABLE, scene_threads


@pytest.mark.parametrize(("given", "threads"), [(None, 1), ("", 1), ("3", 3), ("0", 1), ("many", 1)])
def test_a_person_decides(given, threads, monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    if given is not None:
        monkeypatch.setenv(VARIABLE, given)
    assert scene_threads() == threads
