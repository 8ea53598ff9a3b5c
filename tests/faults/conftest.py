"""A small chain of the workflow's own scripts, which takes seconds, and the toy; each with results of an undisturbed run."""

import abc
import contextlib
import csv
import os
import random
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
TIMED = ("timing", "training")
"""Tables of the toy that say how long something took."""
MOST_IDLE_S = 90.0
"""Longest time without any work."""


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


def end_of(process: subprocess.Popen, most_work_s: float) -> int:
    """Exit code of a run, which has no time to be done, but must work: it hangs when none of its processes did for long."""
    before, since = -1.0, time.monotonic()
    while process.poll() is None:
        now = worked(process)
        if now != before:
            before, since = now, time.monotonic()
        assert time.monotonic() - since < MOST_IDLE_S, f"nothing happens in process {process.pid}"
        assert now < most_work_s, f"process {process.pid} works without end"
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=0.2)
    return process.returncode


class Runs(abc.ABC):
    """A working folder, and the runs in it."""

    most_work_s: float
    """Most processor time of one run."""
    part: float
    """Up to this part of an undisturbed run's work is done before a run is killed."""
    in_a_row: int
    """Most kills before a run may finish: a run must also survive the remains of several."""

    def __init__(self, folder: Path, said: Path | None = None) -> None:
        self.folder = folder
        self.file = said or folder.parent / f"{folder.name}.said"
        folder.mkdir(parents=True, exist_ok=True)

    @abc.abstractmethod
    def given(self) -> list[str]:
        """Arguments of every run."""

    @abc.abstractmethod
    def equal(self, results: Path) -> dict[str, bytes]:
        """What has to be the same whatever happened, by its name."""

    @abc.abstractmethod
    def forget_some(self, draw: random.Random) -> None:
        """Remove some of the results; the rest is as it was."""

    def start(self, *arguments: str, **how) -> subprocess.Popen:
        """Begin a run, in a group of processes of its own; what it says goes to a file."""
        command = [sys.executable, "-m", "gsbridge", "run", "--directory", str(self.folder)]
        command += ["--workflow-profile", str(ROOT / "profiles" / "default"), *self.given(), *arguments]
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
        return self.end_of(self.start(*arguments, **how))

    def end_of(self, process: subprocess.Popen) -> int:
        """Exit code of a run that was begun."""
        return end_of(process, self.most_work_s)

    def finish(self) -> dict[str, bytes]:
        """What lies there after a plain rerun, which must succeed."""
        code = self.run()
        assert code == 0, self.said()[-3000:]
        return self.tree()

    def tree(self) -> dict[str, bytes]:
        """What has to be the same, as it lies there now."""
        return self.equal(self.folder / "results")

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


class Chain(Runs):
    """Photos of two captures, whose keyframes are chosen, and what is counted of them."""

    most_work_s = 300.0
    part = 1.1
    in_a_row = 5

    def __init__(self, folder: Path, said: Path | None = None) -> None:
        super().__init__(folder, said)
        for seed, name in enumerate(SCENES):
            photos(folder / "captures" / name, seed)
        self.config = {"capture": KeyframeSettings().model_dump()}
        self.write_config()

    def write_config(self) -> None:
        (self.folder / "config.yaml").write_text(yaml.safe_dump(self.config))

    def given(self) -> list[str]:
        return ["--snakefile", str(SNAKEFILE), "--configfile", str(self.folder / "config.yaml"), "--cores", "2"]

    def equal(self, results: Path) -> dict[str, bytes]:
        """Bytes of all results."""
        files = (file for file in results.rglob("*") if file.is_file() and file.name != ".snakemake_timestamp")
        named = ((file.relative_to(results), file) for file in files)
        return {str(name): file.read_bytes() for name, file in named if name.parts[0] not in UNEQUAL}

    def forget_some(self, draw: random.Random) -> None:
        shutil.rmtree(self.folder / "results/scenes" / draw.choice(SCENES))
        (self.folder / "results/digests.txt").unlink()


class Toy(Runs):
    """`make toy`: every stage, on one object and one background. Its runs are killed often before one may finish."""

    most_work_s = 4 * 3600.0
    part = 0.2
    in_a_row = 20
    targets = os.environ.get("GSBRIDGE_FAULTS_TARGETS", "all results/gap-benchmark/report.html").split()
    same = ("rows/*", "tables/*", "figures/*", "scenes/**/*.ply", "policies/**/*.safetensors", "trials/**/seed*.csv")
    """What is compared: rows, tables and figures, and the splats, meshes, policies and trials behind them."""
    kinds = (".csv", ".md", ".tex", ".png", ".ply", ".safetensors")

    def given(self) -> list[str]:
        return ["--snakefile", str(ROOT / "Snakefile"), "--config", "preset=toy", "--", *self.targets]

    def equal(self, results: Path) -> dict[str, bytes]:
        """Bytes of what tells no times; of the table of trainings, the columns that tell none."""
        files = (file for pattern in self.same for file in results.glob(pattern) if file.suffix in self.kinds)
        found = {str(file.relative_to(results)): file.read_bytes() for file in files if file.stem not in TIMED}
        table = results / "rows/training.csv"
        for number, row in enumerate(csv.DictReader(table.open(newline=""))) if table.is_file() else ():
            kept = [f"{name}={value}" for name, value in row.items() if not name.startswith(("cpu_", "frames_per_second"))]
            found[f"rows/training.csv:{number}"] = "\n".join(kept).encode()
        return found

    def forget_some(self, draw: random.Random) -> None:
        scenes = sorted(path for path in (self.folder / "results/scenes").iterdir() if path.is_dir())
        for folder in (draw.choice(scenes), self.folder / "results/tables"):
            shutil.rmtree(folder, ignore_errors=True)


def measured(runs: Runs) -> tuple[dict[str, bytes], float]:
    """Results of a run that nothing happened to, and the processor time that it took, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = runs.finish()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return found, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory):
    """What the chain makes, and the processor time that it takes, s."""
    found, work = measured(Chain(tmp_path_factory.mktemp("undisturbed") / "run"))
    assert len(found) > 12
    return found, work


@pytest.fixture
def chain(tmp_path):
    made = Chain(tmp_path / "run")
    yield made
    made.end()


@pytest.fixture
def toy(tmp_path):
    made = Toy(tmp_path / "toy")
    yield made
    made.end()
