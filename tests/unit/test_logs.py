"""Progress lines that tell the truth about the time left."""

import io
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
    clock[0] = 1.0
    progress.update(count=9)
    clock[0] = 100.0
    progress.update(count=990)
    assert caplog.messages[-1] == "work: 999/1000, 10/s, 1 s left"
    clock[0] = 400.0
    progress.update("a note")
    assert caplog.messages[-1] == "work: 1000/1000, 2.5/s, done in 400 s, a note"


def test_the_first_item_waits_for_the_compiler_and_does_not_count(clock, caplog):
    caplog.set_level(logging.INFO)
    progress = logs.ProgressLog(101, "work", every_s=0.0)
    clock[0] = 90.0
    progress.update()
    assert caplog.messages[-1] == "work: 1/101"
    clock[0] = 95.0
    progress.update(count=50)
    assert caplog.messages[-1] == "work: 51/101, 10/s, 5 s left"


@pytest.mark.parametrize("job", [False, True])
def test_only_a_program_that_has_the_terminal_for_itself_writes_over_its_line(job, clock, tmp_path, monkeypatch):
    """Jobs of one run share a terminal."""
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr(logs.sys, "stderr", terminal)
    monkeypatch.setattr(logs, "_in_a_job", job)
    progress = logs.ProgressLog(4, "work")
    for _ in range(3):
        clock[0] += 11.0
        progress.update()
    assert ("\r" in terminal.getvalue()) is not job


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
