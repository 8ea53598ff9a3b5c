"""A small chain of the workflow's own scripts, which takes seconds, and what it makes when nobody disturbs it."""

import contextlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest
import yaml

from gsbridge.configuration.capture import KeyframeSettings

ROOT = Path(__file__).resolve().parents[2]
SNAKEFILE = Path(__file__).with_name("Snakefile")
SCENES = ("cup", "jug")
UNEQUAL = ("logs", "benchmarks", ".state")
"""Folders below `results/` that tell about a run rather than about its results."""
MOST_IDLE_S = 90.0
MOST_WORK_S = 300.0
"""Longest time without any work, and most processor time; an undisturbed run takes some seconds of the latter."""


def photos(folder: Path, seed: int, count: int = 6) -> None:
    """Photos full of corners, as the choice of keyframes wants them."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    blocks = rng.integers(0, 255, (60, 80, 3), dtype=np.uint8)
    for index in range(count):
        picture = cv2.resize(np.roll(blocks, index, axis=1), (320, 240), interpolation=cv2.INTER_NEAREST)
        cv2.imwrite(str(folder / f"{index:04d}.jpg"), picture)


def worked(process: subprocess.Popen) -> float:
    """Processor time that a run and its jobs have taken so far, s: how far it has come, however busy the machine is."""
    try:
        run = psutil.Process(process.pid)
        return sum(sum(one.cpu_times()[:4]) for one in (run, *run.children(recursive=True)))
    except psutil.NoSuchProcess:
        return 0.0


def end_of(process: subprocess.Popen) -> int:
    """Exit code of a run, which has no time to be done, but must work: it hangs when none of its processes did for long."""
    before, since = -1.0, time.monotonic()
    while process.poll() is None:
        now = worked(process)
        if now != before:
            before, since = now, time.monotonic()
        assert time.monotonic() - since < MOST_IDLE_S, f"nothing happens in process {process.pid}"
        assert now < MOST_WORK_S, f"process {process.pid} works without end"
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=0.2)
    return process.returncode


class Chain:
    """A working folder with captures and a case, and the runs in it."""

    def __init__(self, folder: Path, said: Path | None = None) -> None:
        self.folder = folder
        self.file = said or folder.parent / f"{folder.name}.said"
        folder.mkdir(parents=True, exist_ok=True)
        for seed, name in enumerate(SCENES):
            photos(folder / "captures" / name, seed)
        self.config = {"capture": KeyframeSettings().model_dump()}
        self.write_config()

    def write_config(self) -> None:
        (self.folder / "config.yaml").write_text(yaml.safe_dump(self.config))

    def start(self, *arguments: str, **how) -> subprocess.Popen:
        """Begin a run, in a group of processes of its own; what it says goes to a file."""
        command = [sys.executable, "-m", "gsbridge", "run", "--snakefile", str(SNAKEFILE), "--directory", str(self.folder)]
        command += ["--configfile", str(self.folder / "config.yaml"), "--workflow-profile", str(ROOT / "profiles" / "default")]
        command += ["--cores", "2", *arguments]
        prepare = how.pop("prepare", lambda: None)

        def begin() -> None:
            # A test run in the background ignores Ctrl-C, and its children would, too.
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            prepare()

        said = self.file.open("w")
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=said, stderr=said, start_new_session=True, preexec_fn=begin, **how
        )

    def said(self) -> str:
        return self.file.read_text()

    def run(self, *arguments: str, **how) -> int:
        """A run from beginning to end; its exit code."""
        return end_of(self.start(*arguments, **how))

    def finish(self) -> dict[str, bytes]:
        """What lies there after a plain rerun, which must succeed."""
        code = self.run()
        assert code == 0, self.said()[-3000:]
        return self.tree()

    def tree(self) -> dict[str, bytes]:
        """Bytes of all results."""
        results = self.folder / "results"
        files = (file for file in results.rglob("*") if file.is_file() and file.name != ".snakemake_timestamp")
        named = ((file.relative_to(results), file) for file in files)
        return {str(name): file.read_bytes() for name, file in named if name.parts[0] not in UNEQUAL}

    def clear(self) -> None:
        """Forget all results."""
        shutil.rmtree(self.folder / "results", ignore_errors=True)

    def end(self) -> None:
        """End whatever still works in the folder."""
        for process in psutil.process_iter(["pid"]):
            try:
                if process.pid != os.getpid() and Path(process.cwd()).is_relative_to(self.folder):
                    process.kill()
            except psutil.Error:
                continue


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory):
    """Results of a run that nothing happened to, and the processor time that it took, s."""
    chain = Chain(tmp_path_factory.mktemp("undisturbed") / "run")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = chain.finish()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert len(found) > 12
    return found, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.fixture
def chain(tmp_path):
    made = Chain(tmp_path / "run")
    yield made
    made.end()
