"""A run that was killed goes on when the same command is given again; two runs never share a folder."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from gsbridge.workflow_lock import end_orphans, is_passive, running_in, working_folder

SNAKEFILE = """
if config.get("spoilt"):
    raise SystemExit("ERROR config: spoilt is no key. Remove it")
rule slow:
    output: "slow.txt"
    script: "scripts/slow.py"
"""
SCRIPT = """
import time
from pathlib import Path
Path("started").write_text("x")
while not Path("go").exists():
    time.sleep(0.05)
Path(snakemake.output[0]).write_text("done")
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "Snakefile").write_text(SNAKEFILE)
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "slow.py").write_text(SCRIPT)
    yield tmp_path
    for process in psutil.process_iter(["pid"]):
        try:
            if process.pid != os.getpid() and process.cwd() == str(tmp_path):
                process.kill()
        except psutil.Error:
            continue


def start(folder, *more):
    command = [sys.executable, "-m", "gsbridge", "run", "--cores", "1", "--rerun-incomplete", "slow.txt", *more]
    # A file, not a pipe: a job that outlives its run keeps a pipe open.
    with (folder / "said").open("w") as said:
        return subprocess.Popen(command, cwd=folder, stdout=said, stderr=subprocess.STDOUT)


def ended(process, folder):
    """Exit code and what was said."""
    return process.wait(timeout=120), (folder / "said").read_text()


def started(folder, seconds=120):
    until = time.monotonic() + seconds
    while not (folder / "started").exists():
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_the_same_command_goes_on_after_a_kill(folder, how):
    first = start(folder)
    started(folder)
    first.send_signal(how)
    if how is not signal.SIGKILL:
        (folder / "go").write_text("")  # snakemake waits for jobs that run
    ended(first, folder)
    (folder / "go").write_text("")
    code, said = ended(start(folder), folder)
    assert code == 0, said
    assert (folder / "slow.txt").read_text() == "done"


def test_without_a_home_folder_the_cache_lies_in_the_working_folder(folder):
    (folder / "go").touch()
    surroundings = {name: value for name, value in os.environ.items() if name != "XDG_CACHE_HOME"} | {"HOME": "/proc/nowhere"}
    call = [sys.executable, "-m", "gsbridge", "run", "--cores", "1", "slow.txt"]
    process = subprocess.run(call, cwd=folder, env=surroundings, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    assert "the home folder cannot be written" in process.stderr
    assert (folder / ".snakemake/cache").is_dir()


def test_a_mistake_in_the_command_after_a_kill_is_told_in_one_line(folder):
    first = start(folder)
    started(folder)
    first.kill()
    ended(first, folder)
    code, said = ended(start(folder, "--config", "spoilt=1"), folder)
    assert code == 1
    assert "ERROR config: spoilt is no key. Remove it" in said
    assert "Traceback" not in said
    (folder / "go").write_text("")
    code, said = ended(start(folder), folder)
    assert code == 0, said
    assert "going on where it was" in said


def test_a_job_that_outlived_its_run_is_ended(folder):
    first = start(folder)
    started(folder)
    (job,) = psutil.Process(first.pid).children()
    first.kill()
    ended(first, folder)
    assert job.is_running()
    (folder / "started").unlink()
    second = start(folder)
    started(folder)
    assert not job.is_running()
    (folder / "go").write_text("")
    code, said = ended(second, folder)
    assert code == 0, said
    assert "they were ended" in said


def test_a_second_run_in_the_same_folder_is_refused_and_the_first_goes_on(folder):
    first = start(folder)
    started(folder)
    code, said = ended(start(folder), folder)
    assert code == 1
    assert f"another run works here (process {first.pid})" in said
    (folder / "go").write_text("")
    assert first.wait(timeout=120) == 0


@pytest.mark.parametrize(
    ("call", "at_work"),
    [
        (["python", "bin/snakemake", "all"], True),
        (["python", "-X", "utf8", "-u", "bin/snakemake/__main__.py", "all"], True),
        (["python", "-m", "snakemake", "-k", "--", "-n"], True),
        (["python", "bin/snakemake", "-np"], False),
        (["python", "-m", "snakemake", "--dry-run", "--quiet", "rules", "--nolock"], False),
        (["python", "-m", "snakemake", "--rulegraph=dot"], False),
        (["python", "-c", "import time; time.sleep(60)", "snakemake"], False),
        (["tail", "-f", ".snakemake/log/x.snakemake.log"], False),
        (["tail", "-f", "{folder}/.snakemake/scripts/x.py"], False),
    ],
)
def test_what_only_reads_beside_a_run_is_no_run(tmp_path, call, at_work):
    for place in (".snakemake/log/x.snakemake.log", ".snakemake/scripts/x.py"):
        (tmp_path / place).parent.mkdir(parents=True)
        (tmp_path / place).touch()
    for place in ("snakemake.py", *(word for word in call if word.startswith("bin/"))):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text("import time; time.sleep(60)")
    program = sys.executable if call[0] == "python" else call[0]
    process = subprocess.Popen([program, *(word.format(folder=tmp_path) for word in call[1:])], cwd=tmp_path)
    try:
        until = time.monotonic() + 60
        # A slice: the kernel shows no words at all in the moment at which a process becomes its program.
        while psutil.Process(process.pid).cmdline()[-1:] != [call[-1].format(folder=tmp_path)]:
            assert time.monotonic() < until
        assert running_in(tmp_path) == [process.pid] * at_work
        assert end_orphans(tmp_path) == 0
        assert process.poll() is None
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize(
    ("arguments", "passive"),
    [
        (["-np"], True),
        (["-Fn", "all"], True),
        (["-q", "all", "--", "-n"], False),
        (["-jn"], False),
        (["--config", "a=-n"], False),
        (["--dag=dot"], True),
        (["-l"], True),
    ],
)
def test_dry_runs_are_known_by_their_options(arguments, passive):
    assert is_passive(arguments) == passive


def test_the_folder_is_the_one_that_snakemake_is_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert working_folder(["all"]) == tmp_path
    assert working_folder(["--directory", "toy", "all"]) == tmp_path / "toy"
    assert working_folder(["--directory=toy"]) == tmp_path / "toy"
