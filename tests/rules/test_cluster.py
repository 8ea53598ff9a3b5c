"""The first stages through a real SLURM of one node, which is started for them; jobs that are lost are made again."""

import contextlib
import importlib.util
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

ROOT = Path(__file__).resolve().parents[2]
DAEMONS = ("munged", "slurmctld", "slurmd")
SETTINGS = "films={frames: 8, width: 160, height: 120, spp: 4, held_out_spp: 4}"
CONFIGURATION = """\
ClusterName=gsbridge
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=30
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
ReturnToService=2
MailProg=/bin/true
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=6000 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def free_ports(count):
    """Ports that nothing listens on."""
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


@pytest.fixture
def slurm(tmp_path_factory):
    """Environment of commands that talk to a SLURM of this machine alone."""
    missing = [name for name in DAEMONS if shutil.which(name) is None]
    if missing or os.geteuid() or importlib.util.find_spec("snakemake_executor_plugin_slurm") is None:
        pytest.skip("needs SLURM: root, Debian's slurm-wlm and munge, and the extra 'slurm'")
    # Not below the folder of tests: the path of a socket has room for some hundred signs.
    folder = tmp_path_factory.mktemp("slurm")
    for name in ("state", "spool"):
        (folder / name).mkdir()
    folder.chmod(0o700)
    (folder / "munge.key").write_bytes(os.urandom(128))
    (folder / "munge.key").chmod(0o400)
    host = socket.gethostname().split(".")[0]
    (folder / "slurm.conf").write_text(
        CONFIGURATION.format(host=host, ports=free_ports(2), folder=folder, cpus=os.cpu_count() or 1)
    )
    environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf"), "PATH": f"{folder}/bin:{os.environ['PATH']}"}
    # The plugin removes SLURM_CONF from the environment of jobs, but this configuration lies where no command looks by default.
    (folder / "bin").mkdir()
    (folder / "bin/srun").write_text(f'#!/bin/sh\nSLURM_CONF={folder}/slurm.conf exec {shutil.which("srun")} "$@"\n')
    (folder / "bin/srun").chmod(0o755)
    munge = {name: folder / f"munge.{name}" for name in ("socket", "key", "log", "pid", "seed")}
    options = [f"--socket={munge['socket']}", f"--key-file={munge['key']}", f"--log-file={munge['log']}"]
    options += [f"--pid-file={munge['pid']}", f"--seed-file={munge['seed']}"]
    processes = []

    def begin(*command):
        quiet = subprocess.DEVNULL
        processes.append(subprocess.Popen(command, env=environment, stdout=quiet, stderr=quiet, start_new_session=True))

    def lose_node(number):
        """The node goes down, as if its power had failed, with the job that it worked on; then it starts again."""
        kill_job(number, slurm_too=True)
        processes[-1].kill()
        processes.pop().wait()
        said(environment, "scontrol", "update", f"NodeName={host}", "State=DOWN", "Reason=power")
        wait_for(lambda: "down" in said(environment, "sinfo"), 60)
        begin("slurmd", "-D")

    try:
        begin("munged", "--force", "--foreground", *options)
        wait_for(lambda: munge["socket"].exists(), 30)
        begin("slurmctld", "-D")
        begin("slurmd", "-D")
        wait_for(lambda: "idle" in said(environment, "sinfo"), 60)
        yield environment, lose_node
    finally:
        said(environment, "scancel", "--user", "root")
        for process in reversed(processes):
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(timeout=30)


def said(environment, *command):
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False).stdout


def wait_for(happened, seconds):
    until = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < until, "it did not happen in time"
        time.sleep(0.2)


def kill_job(number, *, slurm_too=False):
    """End all processes of a job at once, as the killer of processes that take too much memory does.

    Args:
        number: The job's.
        slurm_too: Whether SLURM's own process for it ends with them, so that nobody tells what happened.
    """
    step = f"slurmstepd: [{number}."
    steps, family = [], []

    def works():
        steps[:] = [one for one in psutil.process_iter(["cmdline"]) if step in " ".join(one.info["cmdline"] or [])]
        family[:] = [child for one in steps for child in one.children(recursive=True)]
        return family

    # The rule's log may still be the one of the lost job, which writes until it has ended.
    wait_for(works, 60)
    for one in [*(steps if slurm_too else []), *family]:
        with contextlib.suppress(psutil.NoSuchProcess):
            one.kill()


def test_the_first_stages_run_there_and_jobs_that_are_lost_are_made_again(slurm, tmp_path):
    environment, lose_node = slurm
    target = "results/scenes/small_cube/capture/keyframes.json"
    command = [sys.executable, "-m", "snakemake", "--workflow-profile", str(ROOT / "profiles/slurm")]
    # This SLURM runs two jobs only, so it may be asked for their status more often than a shared one.
    command += ["--directory", str(tmp_path / "run"), "--seconds-between-status-checks", "3"]
    command += ["--slurm-init-seconds-before-status-checks", "2"]
    command += ["--config", SETTINGS, "--", target]
    with (tmp_path / "said").open("w") as output:
        process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )

    def words():
        return (tmp_path / "said").read_text()

    def next_job(known, log):
        """The number of a job that is not known and writes the log of its rule, and what it asked for."""
        found = []

        def begun():
            found[:] = re.findall(r"^ +(\d+) .* R ", said(environment, "squeue"), re.MULTILINE)
            assert process.poll() is None, words()[-4000:]
            return set(found) - known and log.exists()

        wait_for(begun, 240)
        known.update(found)
        return found[0], said(environment, "scontrol", "show", "job", found[0])

    known: set[str] = set()
    film, keyframes = (tmp_path / f"run/results/logs/{rule}/small_cube.log" for rule in ("film_scene", "select_keyframes"))
    try:
        cancelled, asked = next_job(known, film)
        said(environment, "scancel", cancelled)
        film.unlink()
        killed, _ = next_job(known, film)
        kill_job(killed)
        lost, _ = next_job(known, keyframes)
        lose_node(lost)
        assert process.wait(timeout=400) == 0, words()[-4000:]
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    # The job asks for what the rule states, not for what the machine has on which the run was started.
    assert "NumCPUs=1 " in asked
    assert "mem=2500M" in asked
    assert "TimeLimit=01:00:00" in asked
    assert "gpu" not in asked
    assert words().count("Trying to restart job") == 2
    # SLURM itself puts what a node lost into its queue again, under the same number.
    assert "Restarts=1" in said(environment, "scontrol", "show", "job", lost)
    assert (tmp_path / "run" / target).is_file()
