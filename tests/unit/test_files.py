"""Outputs appear whole or not at all."""

import errno
import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gsbridge import logs
from gsbridge.errors import InputError, StageError
from gsbridge.files import atomic_directory, atomic_file, read_json, write_json, write_stage
from gsbridge.reading import refusing


def test_failed_write_leaves_the_earlier_file_and_no_litter(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("earlier")
    with pytest.raises(KeyboardInterrupt), atomic_file(target) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert target.read_text() == "earlier"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_failed_folder_leaves_the_earlier_folder(tmp_path):
    with atomic_directory(tmp_path / "frames") as folder:
        (folder / "0.txt").write_text("earlier")
    with pytest.raises(OSError, match="full"), atomic_directory(tmp_path / "frames") as folder:
        (folder / "1.txt").write_text("half")
        raise OSError(errno.ENOSPC, "disk full")
    assert [path.name for path in (tmp_path / "frames").iterdir()] == ["0.txt"]
    assert [path.name for path in tmp_path.iterdir()] == ["frames"]


def test_numbers_that_json_lacks_become_null(tmp_path):
    write_json(tmp_path / "a.json", {"x": np.float32(0.5), "n": np.nan, "v": np.arange(3), "p": Path("a")})
    assert json.loads((tmp_path / "a.json").read_text()) == {"x": 0.5, "n": None, "v": [0, 1, 2], "p": "a"}


def test_stage_record_is_degraded_when_there_is_a_reason(tmp_path):
    write_stage(tmp_path / "a.json", seed=3, packages=["numpy"], registered=5)
    write_stage(tmp_path / "b.json", reasons=["few images"])
    first = read_json(tmp_path / "a.json")
    assert (first["status"], first["registered"], first["seed"]) == ("pass", 5, 3)
    assert first["versions"]["numpy"] == np.__version__
    assert read_json(tmp_path / "b.json")["status"] == "degraded"


def test_a_full_disk_names_the_file(tmp_path):
    """The error of a write carries no name; that of a whole file does."""
    with pytest.raises(OSError, match=r"cloud\.ply") as caught, atomic_file(tmp_path / "cloud.ply"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert caught.value.errno == errno.ENOSPC
    with pytest.raises(OSError, match="masks"), atomic_directory(tmp_path / "masks"):
        raise OSError(errno.EDQUOT, "Quota exceeded")
    assert list(tmp_path.iterdir()) == []


def test_leftovers_of_killed_writers_are_swept(tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    (tmp_path / f".a.{dead.pid}.part.json").write_text("half")
    (tmp_path / f".frames.{dead.pid}.part").mkdir()
    (tmp_path / f".a.{os.getppid()}.part.json").write_text("of a running process")
    write_json(tmp_path / "a.json", {})
    with atomic_directory(tmp_path / "frames"):
        pass
    assert {path.name for path in tmp_path.iterdir()} == {"a.json", "frames", f".a.{os.getppid()}.part.json"}


@pytest.mark.parametrize("text", ["{", "[1]", "\xff"])
def test_damaged_json_is_named(tmp_path, text):
    path = tmp_path / "a.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match=r"a\.json"):
        read_json(path)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a device that is always full")
def test_a_disk_that_is_full_while_a_file_is_read_is_no_fault_of_the_file():
    """A reader that unpacks to a full disk, here to the kernel's own; other errors of the system blame the file."""

    def unpack():
        with refusing("a.mcap", "it is damaged", "Record it again"), open("/dev/full", "wb", buffering=0) as unpacked:
            unpacked.write(b"1")

    with pytest.raises(OSError, match="No space left") as caught:
        unpack()
    assert caught.value.errno == errno.ENOSPC
    said = r"a\.mcap: it is damaged \(.*Input/output error.*\)\. Record it again"
    with pytest.raises(InputError, match=said), refusing("a.mcap", "it is damaged", "Record it again"):
        raise OSError(errno.EIO, "Input/output error")


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (InputError("a.mp4", "the file is empty", "Film again"), "a.mp4: the file is empty. Film again"),
        (StageError("sfm of x", "6 of 50 registered", "Film slower"), "sfm of x: 6 of 50 registered. Film slower"),
        (OSError(errno.ENOSPC, "No space left on device", "b.ply"), "no space left on the disk while writing b.ply"),
        (KeyboardInterrupt(), "interrupted"),
    ],
)
def test_last_words_of_a_job_are_one_line(tmp_path, error, line):
    before = sys.excepthook, logging.getLogger().handlers[:]
    try:
        logs.start(1, tmp_path / "job.log")
        sys.excepthook(type(error), error, None)
        text = (tmp_path / "job.log").read_text()
    finally:
        sys.excepthook = before[0]
        logging.getLogger().handlers[:] = before[1]
    assert line in text
    assert len(text.splitlines()) == 1
    assert "Traceback" not in text
