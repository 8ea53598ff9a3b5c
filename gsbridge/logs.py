"""Logging, thread limits and progress of one process."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import TypeVar

from gsbridge.errors import NO_ROOM, GsbridgeError

logger = logging.getLogger("gsbridge")

T = TypeVar("T")

_THREAD_VARIABLES = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
_SINGLE_VARIABLES = ("MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMEXPR_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Linear algebra stays on one thread: its matrices are small, and with more threads its sums round in another order."""

_threads = 1
_in_a_job = False


def start(threads: int, log: str | Path | None) -> None:
    """Prepare a job's process: limit the threads of every library, start the log, and make fatal errors readable.

    Snakemake limits OMP and MKL only; numba, OpenCV, torch and Mitsuba each have their own switch. Call it before the
    heavy imports of the job: the environment variables are read when those libraries load.

    Args:
        threads: Threads the job may use, at least 1.
        log: File that receives the log beside stderr; None for stderr only.
    """
    global _threads, _in_a_job
    _threads, _in_a_job = max(1, int(threads)), log is not None
    for variable in _THREAD_VARIABLES:
        # numba refuses to compile when its variable changes after it was loaded; it is limited by a call instead.
        if variable != "NUMBA_NUM_THREADS" or "numba" not in sys.modules:
            os.environ[variable] = str(_threads)
    for variable in _SINGLE_VARIABLES:
        os.environ[variable] = "1"
    # Waiting threads sleep: by default they spin, and on cores shared with other jobs that made two threads slower than one.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    _limit_loaded_libraries(_threads)
    handlers: list[logging.Handler] = [logging.StreamHandler(sys.stderr)]
    if log is not None:
        Path(log).parent.mkdir(parents=True, exist_ok=True)
        handlers.append(logging.FileHandler(log, mode="w", encoding="utf-8"))
    logging.basicConfig(
        level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s", datefmt="%H:%M:%S", handlers=handlers, force=True
    )
    sys.excepthook = _log_exception


def threads() -> int:
    """Threads this process may use, as given to `start` (1 before it is called)."""
    return _threads


@contextlib.contextmanager
def limited(count: int) -> Iterator[None]:
    """Let `threads` return at most `count` inside the block; the limits of libraries stay as `start` set them."""
    global _threads
    before = _threads
    _threads = min(count, before)
    try:
        yield
    finally:
        _threads = before


def _limit_loaded_libraries(count: int) -> None:
    """Set the limits of libraries that were imported before `start`, which no longer read the environment."""
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(count)
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(count)
    if "numba" in sys.modules:
        numba = sys.modules["numba"]
        numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))


def _log_exception(kind: type[BaseException], value: BaseException, trace: TracebackType | None) -> None:
    """Log the error that ends a job: in one line for a user's mistake, with a traceback for a fault of the code."""
    if issubclass(kind, KeyboardInterrupt):
        logger.error("interrupted; run the same command again to go on")
    elif issubclass(kind, GsbridgeError):
        logger.error("%s", value)
    elif isinstance(value, OSError) and value.errno in NO_ROOM:
        logger.error(
            "no space left on the disk while writing %s; free some room and run the same command again", value.filename
        )
    else:
        logger.critical("unexpected error", exc_info=(kind, value, trace))


class ProgressLog:
    """Count of done items with a rate and the time left: one live line on a terminal, plain lines in a log.

    A job of the workflow writes plain lines on a terminal, too: several jobs would overwrite each other. Rate and time left are
    measured from the first call of `update` on, since the items before it may have waited for code to be compiled.

    Args:
        total: Number of items.
        label: What is being done, for example "train soft".
        every_s: Seconds between two lines in a log.
    """

    def __init__(self, total: int, label: str, every_s: float = 10.0) -> None:
        self.total = total
        self.label = label
        self.done = 0
        self._begin = time.monotonic()
        self._last = self._begin
        self._first: tuple[float, int] | None = None
        self._terminal = sys.stderr.isatty() and not _in_a_job
        self._every = 0.2 if self._terminal else every_s

    def update(self, note: str = "", count: int = 1) -> None:
        """Count `count` finished items and report when it is time; `note` is appended (a loss, a file name)."""
        self.done += count
        now = time.monotonic()
        if self._first is None:
            self._first = now, self.done
        if now - self._last < self._every and self.done < self.total:
            return
        self._last = now
        parts = [f"{self.label}: {self.done}/{self.total}", *self._pace(now)]
        line = ", ".join(parts)
        line = f"{line}, {note}" if note else line
        if not self._terminal:
            logger.info(line)
            return
        end = "\n" if self.done >= self.total else ""
        sys.stderr.write(f"\r\x1b[K{line}{end}")
        sys.stderr.flush()

    def counted(self, items: Iterable[T]) -> Iterator[T]:
        """Iterate over `items`, and count each once the caller is done with it."""
        for item in items:
            yield item
            self.update()

    def _pace(self, now: float) -> list[str]:
        """Rate and time left, rounded up to seconds; at the end the time that the items took, since other work may follow."""
        if self.done >= self.total:
            taken = now - self._begin
            return [f"{self.done / max(taken, 1e-9):.3g}/s", f"done in {taken:.0f} s"]
        assert self._first is not None
        begin, counted = self._first
        if self.done == counted:
            return []
        rate = (self.done - counted) / max(now - begin, 1e-9)
        return [f"{rate:.3g}/s", f"{math.ceil((self.total - self.done) / rate)} s left"]


def track(items: Iterable[T], label: str, total: int | None = None) -> Iterator[T]:
    """Iterate over `items` with a `ProgressLog` line.

    Args:
        items: What to iterate over.
        label: Text in front of the progress line.
        total: Number of items; `len(items)` when None. An iterator has no length and needs it.
    """
    count = total if total is not None else len(items)  # type: ignore[arg-type]
    yield from ProgressLog(count, label).counted(items)
