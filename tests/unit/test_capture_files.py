"""Which files a capture consists of, and which changes make it count as another capture."""

import hashlib
import json
import os

import pytest

from gsbridge.experiment.capture_files import capture_files, content_digests


@pytest.fixture
def project(tmp_path):
    """A folder of photos, a COLMAP project, and a transforms file that names its photos with and without a suffix."""
    for name in ("cup/a.jpg", "cup/.DS_Store", "jar/sparse/0/images.bin", "jar/images/a.jpg", "jug/images/a.png", "jug/b.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    frames = [{"file_path": "images/a"}, {"file_path": "b.png"}, {"file_path": "lost"}]
    (tmp_path / "jug/transforms.json").write_text(json.dumps({"frames": frames}))
    (tmp_path / "results/.state").mkdir(parents=True)
    return tmp_path


@pytest.mark.parametrize(
    ("kind", "path", "names"),
    [
        ("images", "cup", {"a.jpg"}),
        ("colmap", "jar/sparse/0", {"images.bin", "../../images/a.jpg"}),
        ("colmap", "jar", {"sparse/0/images.bin", "images/a.jpg"}),
        ("nerfstudio", "jug/transforms.json", {"images/a.png", "b.png"}),
        ("nerfstudio", "cup/a.jpg", set()),
        ("video", "cup/a.jpg", set()),
    ],
)
def test_every_file_that_is_read_counts(project, kind, path, names):
    source = project / path
    folder = source if source.is_dir() else source.parent
    store = project / "results/.state/captures/a.json"
    assert {name for name, _ in content_digests(capture_files(kind, source), folder, store)} == names


def test_contents_count_and_dates_do_not(project):
    photo, store = project / "cup/a.jpg", project / "results/.state/captures/cup.json"

    def listing():
        return content_digests(capture_files("images", photo.parent), photo.parent, store)

    before = listing()
    assert before == [("a.jpg", hashlib.sha256(b"cup/a.jpg").hexdigest()[:16])]
    os.utime(photo, (1e9, 1e9))
    assert listing() == before
    photo.write_text("CUP/A.JPG")
    assert listing() != before


def test_contents_are_read_once(project, monkeypatch):
    photo, store = project / "cup/a.jpg", project / "results/.state/captures/cup.json"
    before = content_digests([photo], photo.parent, store)
    monkeypatch.setattr(hashlib, "file_digest", lambda *_: pytest.fail("it was read again"))
    assert content_digests([photo], photo.parent, store) == before


def test_where_there_are_no_results_yet_nothing_is_written(project):
    store = project / "elsewhere/results/.state/captures/cup.json"
    assert len(content_digests([project / "cup/a.jpg"], project, store)) == 1
    assert not (project / "elsewhere").exists()
