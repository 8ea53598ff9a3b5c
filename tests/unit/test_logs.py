"""Progress lines that tell the truth about the time left."""

import logging

import pytest

from gsbridge import logs


@pytest.fixture
def clock(monkeypatch):
    """Seconds that pass only when told."""
    now = [0.0]
    monkeypatch.setattr(logs.time, "monotonic", lambda: now[0])
    return now


def test_progress_never_says_that_nothing_is_left_before_the_end(clock, caplog):
    caplog.set_level(logging.INFO)
    progress = logs.ProgressLog(1000, "work", every_s=0.0)
    clock[0] = 100.0
    progress.update(count=999)
    assert caplog.messages[-1] == "work: 999/1000, 9.99/s, 1 s left"
    clock[0] = 400.0
    progress.update("a note")
    assert caplog.messages[-1] == "work: 1000/1000, 2.5/s, done in 400 s, a note"


def test_counted_items_come_back_in_order(clock, caplog):
    caplog.set_level(logging.INFO)
    progress = logs.ProgressLog(4, "work", every_s=0.0)
    assert list(progress.counted("ab")) == ["a", "b"]
    assert progress.done == 2
    assert list(logs.track([3, 2, 1], "other")) == [3, 2, 1]
    assert caplog.messages[-1].startswith("other: 3/3")


def test_fewer_threads_for_the_time_being(monkeypatch):
    monkeypatch.setattr(logs, "_threads", 4)
    with logs.limited(1):
        assert logs.threads() == 1
    with logs.limited(8):
        assert logs.threads() == 4
    assert logs.threads() == 4
