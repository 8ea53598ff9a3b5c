"""One run at a time in a working folder, and going on after a run that was killed.

Snakemake locks its working folder with files, which stay when it is killed; the same command then ends with a request for
`--unlock`. `start_workflow` also holds a lock of the operating system, which ends with the process, however that ends. A
process that gets this lock, and sees no other snakemake at work in the folder, may remove the files.

`end_when_asked` removes a deadlock in snakemake's handling of SIGTERM.
"""

from __future__ import annotations

import fcntl
import itertools
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import psutil

from gsbridge.errors import InputError
from gsbridge.notebook import cache_root
from gsbridge.workflow_faults import told
from gsbridge.workflow_files import check_configuration_files, check_targets, check_workflow, configuration_files

_PASSIVE = frozenset(
    {
        "-n", "--dry-run", "--dryrun", "--dag", "--rulegraph", "--filegraph", "--d3dag", "--summary", "-S",
        "--detailed-summary", "-D", "--lint", "--list-rules", "--list", "-l", "--list-target-rules", "--lt", "--report",
        "--unlock", "--help", "-h", "--version", "-v", "--archive", "--generate-unit-tests",
    }
)  # fmt: skip
"""Arguments with which snakemake runs no job and locks nothing."""
_PASSIVE_LETTERS, _OTHER_LETTERS = frozenset("nSDlhv"), frozenset("pkfFta")
"""Letters that may be joined behind one dash, as in `-np`: those of `_PASSIVE`, and others that take no value."""
_SHELLS = frozenset({"sh", "bash", "dash"})
_WITH_VALUE = frozenset({"-X", "-W"})
"""Options of Python that a value follows."""

_PATIENCE_S = 5.0
"""Time that a job has to end after it is asked to, before it is killed, s."""


def working_folder(arguments: Sequence[str]) -> Path:
    """Working folder of snakemake for the given arguments."""
    for place, argument in enumerate(arguments):
        if argument in ("--directory", "-d") and place + 1 < len(arguments):
            return Path(arguments[place + 1]).resolve()
        if argument.startswith("--directory="):
            return Path(argument.partition("=")[2]).resolve()
    return Path.cwd()


def is_passive(arguments: Sequence[str]) -> bool:
    """Whether snakemake runs no job with the given arguments, and so may stand beside a run.

    Args:
        arguments: Arguments as on snakemake's command line.
    """
    options = itertools.takewhile(lambda argument: argument != "--", arguments)
    return any(option.partition("=")[0] in _PASSIVE or _holds_passive_letter(option) for option in options)


def _holds_passive_letter(option: str) -> bool:
    """Whether letters that are joined behind one dash hold a passive one; behind a letter that takes a value, they are that."""
    if not re.fullmatch("-[A-Za-z]+", option):
        return False
    last = next((letter for letter in option[1:] if letter not in _OTHER_LETTERS), "")
    return last in _PASSIVE_LETTERS


def _arguments_of_snakemake(words: Sequence[str]) -> list[str] | None:
    """Arguments of a process that is snakemake; None for another one, such as an editor of its files.

    Args:
        words: The program of the process and its arguments.
    """
    if words and Path(words[0]).name == "snakemake":
        return list(words[1:])
    if not (words and _is_python(words[0])):
        return None
    place = 1
    while place < len(words) and words[place].startswith("-") and words[place] not in ("-m", "-c"):
        place += 2 if words[place] in _WITH_VALUE else 1
    if list(words[place : place + 2]) == ["-m", "snakemake"]:
        return list(words[place + 2 :])
    script = Path(words[place]) if place < len(words) else Path()
    program = script.parent if script.name == "__main__.py" else script
    return list(words[place + 1 :]) if program.name == "snakemake" else None


def _is_python(program: str) -> bool:
    name = Path(program).name
    return name.startswith("python") or name == Path(sys.executable).name


def _runs_script(words: Sequence[str]) -> bool:
    """Whether a process is a job's script, or the shell that waits for one."""
    if not (words and (_is_python(words[0]) or Path(words[0]).name in _SHELLS)):
        return False
    return any(f"{os.sep}.snakemake{os.sep}scripts{os.sep}" in word for word in words[:3])


def _at_work_in(folder: Path) -> Iterator[tuple[psutil.Process, bool]]:
    """Snakemake's processes in a folder that run jobs, without this one, and whether each is only a job's script."""
    for process in psutil.process_iter(["pid", "cmdline"]):
        words = process.info["cmdline"] or []
        job, arguments = _runs_script(words), _arguments_of_snakemake(words)
        # Programs that read snakemake's files, dry runs and `gsbridge status` disturb no run.
        at_work = job or (arguments is not None and not is_passive(arguments))
        if process.info["pid"] == os.getpid() or not at_work:
            continue
        try:
            if Path(process.cwd()) == folder:
                yield process, job
        except (psutil.Error, OSError):
            # The process has ended, or belongs to another user, whose working folder is not this one.
            continue


def running_in(folder: Path) -> list[int]:
    """Process ids of every snakemake that runs jobs in a folder, without this process; the jobs do not count."""
    return [process.pid for process, job in _at_work_in(folder) if not job]


def end_orphans(folder: Path) -> int:
    """End the jobs that still run after their snakemake was killed: a new run would make the same files beside them.

    Returns:
        The number of such jobs.
    """
    jobs = [process for process, job in _at_work_in(folder) if job]
    family = [*jobs, *(child for job in jobs for child in _children(job))]
    for signalled in ("terminate", "kill"):
        for process in family:
            try:
                getattr(process, signalled)()
            except psutil.NoSuchProcess:
                continue
        _, family = psutil.wait_procs(family, timeout=_PATIENCE_S)
    return len(jobs)


def end_when_asked() -> None:
    """Let a run end at SIGTERM, whatever snakemake is doing when the signal comes.

    Snakemake's own handler takes a lock that the interrupted thread holds while it finishes a job or waits for files of a slow
    disk; then neither goes on, and the run hangs until it is killed. In a thread of its own the handler waits for its turn.
    """
    handler = signal.getsignal(signal.SIGTERM)
    if callable(handler):
        call = handler
        signal.signal(signal.SIGTERM, lambda *told: threading.Thread(target=call, args=told, daemon=True).start())


def _children(process: psutil.Process) -> list[psutil.Process]:
    try:
        return process.children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def _ensure_cache(folder: Path, say: Callable[[str], None]) -> None:
    """Let snakemake keep its cache in the working folder where the home folder may not be written, as in some containers."""
    try:
        root = cache_root().parent
        root.mkdir(parents=True, exist_ok=True)
        if os.access(root, os.W_OK):
            return
    except (OSError, RuntimeError):
        # RuntimeError: the user has no home folder.
        pass
    os.environ["XDG_CACHE_HOME"] = str(folder / ".snakemake" / "cache")
    say("the home folder cannot be written; the cache lies in .snakemake/cache")


def start_workflow(arguments: Sequence[str], say: Callable[[str], None]) -> NoReturn:
    """Run snakemake with some arguments; a lock that a killed run left in the working folder is removed first.

    Args:
        arguments: Arguments as on snakemake's command line.
        say: Is called with each sentence for the person who started the run.

    Raises:
        InputError: Another run works in the folder.
        SystemExit: A file of `--configfile` cannot be used, or an option would swallow a target, which snakemake would tell
            with a traceback; or there is no workflow here.
    """
    with told():
        check_targets(arguments)
        check_configuration_files(configuration_files(arguments))
        check_workflow(arguments)
    # The module of this Python, not whichever snakemake the shell finds first.
    command = [sys.executable, "-m", "snakemake", *arguments]
    folder = working_folder(arguments)
    _ensure_cache(folder, say)
    if not is_passive(arguments):
        (folder / ".snakemake").mkdir(parents=True, exist_ok=True)
        # The lock lasts while the file is open: until the process ends, also across `exec`, which closes non-inheritable files.
        held = os.open(folder / ".snakemake" / "run.lock", os.O_RDWR | os.O_CREAT, 0o644)
        os.set_inheritable(held, True)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            others = running_in(folder)
        except BlockingIOError:
            others = running_in(folder) or [int(os.pread(held, 20, 0) or b"0")]
        if others:
            raise InputError(
                str(folder),
                f"another run works here (process {', '.join(map(str, others))})",
                "Wait until it is done, or stop it; then give the same command again",
            )
        os.ftruncate(held, 0)
        os.pwrite(held, str(os.getpid()).encode(), 0)
        if end_orphans(folder):
            say("jobs of a run that was killed were still at work; they were ended")
        locks = folder / ".snakemake" / "locks"
        if locks.is_dir() and any(locks.iterdir()):
            unlock = [*command[:3], "--unlock", *arguments]
            # A mistake in the configuration or in a target fails this call, too. The run meets it again, and tells it.
            done = subprocess.run(unlock, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            if not done.returncode:
                say("an earlier run was killed; going on where it was")
    os.execv(sys.executable, command)


__all__ = ["end_orphans", "end_when_asked", "is_passive", "running_in", "start_workflow", "working_folder"]
