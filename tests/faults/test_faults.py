"""Whatever happens to a run, the same command afterwards ends with the bytes of an undisturbed one.

`GSBRIDGE_FAULTS=100` kills that many runs of a small chain, which takes minutes; by default there are few enough for every run
of the tests. `GSBRIDGE_FAULTS_OVER=toy` kills runs of the whole toy, which takes hours.
"""

import contextlib
import os
import random
import resource
import shutil
import signal
import subprocess
import time

import pytest

from tests.faults.conftest import SCENES, Chain, Runs, measured, worked

KILLS = int(os.environ.get("GSBRIDGE_FAULTS", "3"))
OVER_TOY = os.environ.get("GSBRIDGE_FAULTS_OVER") == "toy"
LATE = "results/late.txt"
WAYS = {
    # Power loss; the out-of-memory killer, which kills snakemake but not its jobs; a scheduler's time limit; Ctrl-C.
    "power": (signal.SIGKILL, True),
    "memory": (signal.SIGKILL, False),
    "term": (signal.SIGTERM, False),
    "ctrl-c": (signal.SIGINT, True),
}


def stop(runs: Runs, process: subprocess.Popen, how: str) -> None:
    """Send a run its signal, alone or with all its jobs; it may have ended already."""
    sent, group = WAYS[how]
    with contextlib.suppress(ProcessLookupError):
        (os.killpg if group else os.kill)(process.pid, sent)
    runs.end_of(process)


def kill_and_finish(runs: Runs, expected: dict[str, bytes], work: float) -> None:
    """Kill runs at random moments, several in a row, and look at what a plain rerun makes, until there were enough kills."""
    draw = random.Random(20261124)
    killed = 0
    while killed < KILLS:
        for _ in range(draw.randint(1, min(runs.in_a_row, KILLS - killed))):
            process = runs.start()
            until, pause = draw.uniform(0, runs.part * work), draw.uniform(0, 0.3)
            while process.poll() is None and worked(process) < until:
                time.sleep(0.02)
            # The pause lets some kills hit jobs that wait and do no work.
            time.sleep(pause)
            stop(runs, process, draw.choice(list(WAYS)))
            killed += 1
        found = runs.finish()
        assert sorted(found) == sorted(expected)
        assert [name for name in expected if found[name] != expected[name]] == []
        assert not [path for path in runs.folder.rglob("*.part") if ".state" not in path.parts]
        if draw.random() < 0.5:
            runs.clear()
        else:
            runs.forget_some(draw)


def test_a_run_killed_anywhere_goes_on_to_the_same_bytes(chain, undisturbed):
    kill_and_finish(chain, *undisturbed)


# Defined only on request, so that other runs of the tests do not count it as skipped.
if OVER_TOY:

    def test_the_toy_killed_anywhere_goes_on_to_the_same_rows_tables_and_figures(toy):
        expected, work = measured(toy)
        assert expected
        toy.clear()
        kill_and_finish(toy, expected, work)


def test_a_run_that_is_asked_to_end_while_it_waits_for_a_file_does(chain):
    """Snakemake alone hangs then: its handler wants the lock that the interrupted thread holds."""
    process = chain.start("--latency-wait", "60", "--cores", "1", "--prioritize", LATE, "--", LATE, "results/digests.txt")
    while "Waiting at most" not in chain.said() and process.poll() is None:
        time.sleep(0.05)
    process.terminate()
    time.sleep(1)
    assert process.poll() is None
    (chain.folder / "appear").touch()
    assert chain.end_of(process) != 0, chain.said()
    assert (chain.folder / LATE).is_file()
    # At most one job was begun meanwhile.
    assert not (chain.folder / "results/digests.txt").exists()


@pytest.mark.parametrize("kilobytes", [1, 60])
def test_after_a_full_disk_the_rest_is_made(chain, undisturbed, kilobytes):
    """No file may grow beyond a limit: a job's output, its log or snakemake's own notes."""
    limit = kilobytes * 1024
    code = chain.run(prepare=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY)))
    assert code != 0
    assert chain.finish() == undisturbed[0]


@pytest.fixture
def small_disk(tmp_path):
    """A disk of its own for a run, of eight megabytes."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(place)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no disk can be mounted here")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


def test_a_disk_that_fills_up_is_named_and_more_room_is_enough(small_disk, undisturbed):
    chain = Chain(small_disk / "run", small_disk.parent / "said")
    room = small_disk / "filling"
    with contextlib.suppress(OSError), room.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))
    assert chain.run() != 0
    assert "Traceback" not in chain.said(), chain.said()
    room.unlink()
    subprocess.run(["mount", "-o", "remount,size=64m", str(small_disk)], check=True)
    assert chain.finish() == undisturbed[0]


def test_results_that_may_not_be_written_end_in_one_line(small_disk, undisturbed):
    chain = Chain(small_disk / "run", small_disk.parent / "said")
    subprocess.run(["mount", "-o", "remount,size=64m,ro", str(small_disk)], check=True)
    assert chain.run() != 0
    said = chain.said()
    assert "Read-only" in said
    assert "Traceback" not in said
    subprocess.run(["mount", "-o", "remount,rw", str(small_disk)], check=True)
    assert chain.finish() == undisturbed[0]


def test_of_two_runs_in_one_folder_one_is_refused_and_the_other_finishes(chain, undisturbed):
    first, second = chain.start(), chain.start()
    codes = sorted([chain.end_of(first), chain.end_of(second)])
    assert codes in ([0, 1], [0, 0])
    assert chain.finish() == undisturbed[0]


def test_a_configuration_that_is_edited_meanwhile_counts_for_the_next_run(chain, undisturbed, tmp_path):
    process = chain.start()
    while not list(chain.folder.glob("results/logs/**/*.log")) and process.poll() is None:
        time.sleep(0.02)
    chain.config["capture"] = {**chain.config.get("capture", {}), "max_side": 64}
    chain.write_config()
    assert chain.end_of(process) == 0
    assert chain.tree() == undisturbed[0]
    edited = Chain(tmp_path / "edited")
    edited.config["capture"] = chain.config["capture"]
    edited.write_config()
    assert chain.finish() == edited.finish() != undisturbed[0]


def test_photos_that_are_exchanged_meanwhile_count_for_the_next_run(chain, undisturbed, tmp_path):
    process = chain.start()
    while not list(chain.folder.glob("results/logs/**/*.log")) and process.poll() is None:
        time.sleep(0.02)
    folders = [chain.folder / "captures" / name for name in ("cup", "jug")]
    data = [path.read_bytes() for path in sorted(folders[1].iterdir())]
    for path, content in zip(sorted(folders[0].iterdir()), data, strict=True):
        path.write_bytes(content)
    chain.end_of(process)
    found = chain.finish()
    start = "scenes/{}/capture/frames/"
    cup, jug = ({name: data for name, data in found.items() if name.startswith(start.format(each))} for each in SCENES)
    assert list(cup.values()) == list(jug.values())
    assert len(cup) == len(data)


def test_a_clock_that_was_ahead_makes_no_difference(chain, undisturbed):
    """Results of a day to come, among others of today."""
    assert chain.finish() == undisturbed[0]
    ahead = time.time() + 86400
    for number, path in enumerate(sorted((chain.folder / "results").rglob("*"))):
        if number % 3:
            os.utime(path, (ahead + number, ahead + number))
    shutil.rmtree(chain.folder / "results/scenes/cup")
    (chain.folder / "results/digests.txt").unlink()
    assert chain.finish() == undisturbed[0]
