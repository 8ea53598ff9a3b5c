"""Earlier versions of results, kept while a job makes new ones."""

import errno
import os
import shutil

import pytest

from gsbridge.workflow_backups import keep, put_back


def write(path, text):
    """A result as stages write it: made beside its place, and then put there. A folder has a file of this text."""
    beside = path.with_name("beside")
    if path.suffix:
        beside.write_text(text)
    else:
        (beside / "part").mkdir(parents=True)
        (beside / "part/file").write_text(text)
        shutil.rmtree(path, ignore_errors=True)
    os.replace(beside, path)


def read(path):
    return (path if path.suffix else path / "part/file").read_text()


@pytest.fixture(params=["result.json", "folder"])
def places(tmp_path, request):
    return tmp_path / request.param, tmp_path / "kept" / "deep" / request.param


def test_an_earlier_version_comes_back_with_its_date(places):
    path, backup = places
    write(path, "first")
    inner = path if path.suffix else path / "part/file"
    os.utime(inner, (1e9, 1e9))
    for _ in range(2):  # The first attempt was killed, and left what it had kept.
        keep(path, backup)
    write(path, "second")
    assert read(backup) == "first"
    assert put_back(path, backup)
    assert (read(path), inner.stat().st_mtime) == ("first", 1e9)
    assert not backup.exists()
    assert not put_back(path, backup)


def test_a_version_comes_back_where_the_new_one_is_missing(places):
    path, backup = places
    write(path, "first")
    keep(path, backup)
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert put_back(path, backup)
    assert read(path) == "first"


def test_links_take_no_room(places):
    path, backup = places
    write(path, "first")
    keep(path, backup)
    kept = backup if backup.suffix else backup / "part/file"
    assert kept.stat().st_nlink == 2


@pytest.mark.parametrize("room", [True, False])
def test_without_links_a_version_is_copied_and_without_room_not_kept(places, monkeypatch, room):
    def refuse(*_):
        raise OSError(errno.EPERM, "no links here")

    def full(*_):
        raise OSError(errno.ENOSPC, "no space left on device")

    path, backup = places
    write(path, "first")
    monkeypatch.setattr(os, "link", refuse)
    if not room:
        monkeypatch.setattr(shutil, "copy2", full)
    keep(path, backup)
    assert backup.exists() == room
    assert read(path) == "first"
