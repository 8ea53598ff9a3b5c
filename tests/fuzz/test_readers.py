"""Every reader of files that others made, with broken and hostile files: one clear line or a result, no traceback and no hang.

`GSBRIDGE_FUZZ=10000` tries that many files over all readers; by default there are few enough for every run of the tests.
"""

import contextlib
import os
import re
import resource
import signal
import threading
import zlib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from gsbridge.capture.sources import Source, list_photos
from gsbridge.errors import GsbridgeError, InputError
from gsbridge.gap.formats.files import case_files
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.images import read_image_u8
from gsbridge.reading import load_yaml, refusing
from tests.fuzz.samples import DATA, READERS, Reader, write_case, write_photo

CASES = int(os.environ.get("GSBRIDGE_FUZZ", "240"))
SECONDS = 5
"""Most processor time of one reading. That of the clock may be more on a busy machine."""
GIGABYTE = 2**30
NONSENSE = (
    "nan",
    "-inf",
    "1e308",
    "-1",
    "0",
    "99999999999999999999",
    '""',
    "[]",
    "{}",
    "null",
    "abc",
    "[1, [2, {}]]",
    "&x [*x]",
)
TAGS = ("!!python/object/apply:os.system ['touch owned']", "!!binary aaaa", "!!set {a, b}", "!!timestamp 2001-99-99")


PLACE = st.integers(0, 2**16)
"""Where a file is broken: counted from its start, and again from there behind its end."""
EDITS: dict[str, st.SearchStrategy[object]] = {
    "cut": st.none(),
    "insert": st.binary(min_size=1, max_size=40),
    "remove": st.integers(1, 40),
    "overwrite": st.binary(min_size=1, max_size=40),
    "repeat": st.tuples(st.integers(1, 40), st.integers(2, 30)),
    "word": st.sampled_from([*NONSENSE, *TAGS]),
}
WORD = re.compile(rb"-?\d[\d.e+-]*|\b[a-z_]{2,}\b")

Edit = tuple[str, int, Any]


def edits(text: bool) -> st.SearchStrategy[list[Edit]]:
    """One to three things to be wrong with a file; of a text also numbers and words, as often as all else."""
    bytewise = st.one_of([st.tuples(st.just(kind), PLACE, what) for kind, what in EDITS.items() if kind != "word"])
    word = st.tuples(st.just("word"), PLACE, EDITS["word"])
    return st.lists(st.one_of(bytewise, word) if text else bytewise, min_size=1, max_size=3)


def broken(data: bytes, wrong: list[Edit]) -> bytes:
    """The data with some things wrong."""
    for kind, place, what in wrong:
        place %= max(len(data), 1)
        words = list(WORD.finditer(data)) if kind == "word" else []
        if kind == "cut":
            data = data[:place]
        elif kind == "insert":
            data = data[:place] + what + data[place:]
        elif kind == "remove":
            data = data[:place] + data[place + what :]
        elif kind == "overwrite":
            data = data[:place] + what + data[place + len(what) :]
        elif kind == "repeat":
            data = data[:place] + data[place : place + what[0]] * what[1] + data[place:]
        elif words:
            word = words[place % len(words)]
            data = data[: word.start()] + what.encode() + data[word.end() :]
    return data


class Hang(BaseException):
    """Reading took too long; nothing may catch it."""


def read_within(reader: Reader, path: Path) -> None:
    """Read, and let only our own errors pass.

    Raises:
        Hang: It took longer than it may.
    """

    def late(*_: object) -> None:
        raise Hang

    assert threading.current_thread() is threading.main_thread()
    timers = {signal.ITIMER_PROF: (signal.SIGPROF, SECONDS), signal.ITIMER_REAL: (signal.SIGALRM, 12 * SECONDS)}
    before = {name: signal.signal(name, late) for name, _ in timers.values()}
    for timer, (_, seconds) in timers.items():
        signal.setitimer(timer, seconds)
    said = ""
    try:
        reader.read(path)
    except GsbridgeError as error:
        said = str(error)
    finally:
        for timer, (name, _) in timers.items():
            signal.setitimer(timer, 0)
            signal.signal(name, before[name])
    assert "\n" not in said.strip(), said
    assert len(said) < 1500, said


@pytest.mark.parametrize("name", READERS)
def test_broken_files_end_in_one_line(name, tmp_path, monkeypatch):
    reader = READERS[name]
    path = reader.write(tmp_path)
    monkeypatch.chdir(tmp_path)
    sound = path.read_bytes()
    reader.read(path)  # it is sound before it is broken
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    # Every run tries the same cases, and every reader has its own; hypothesis shrinks a failing case to a minimal one.
    @seed(zlib.crc32(name.encode()))
    @settings(
        max_examples=max(CASES // len(READERS), 4),
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
        database=None,
        deadline=None,
    )
    @given(edits(reader.text))
    def read_broken(wrong: list[Edit]) -> None:
        path.write_bytes(broken(sound, wrong))
        try:
            read_within(reader, path)
        except Exception:
            raise
        except BaseException as error:
            # A hang, or a panic of a Rust library: it fails at once, since hypothesis must not repeat it.
            pytest.fail(f"{type(error).__name__} with {wrong}")

    read_broken()
    assert not (tmp_path / "owned").exists()
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak) * 1024 < GIGABYTE


NOT_A_NUMBER = {".json": ("NaN", "Infinity", "-Infinity"), ".yaml": (".nan", ".inf", "-.inf")}


@pytest.mark.parametrize("name", [name for name, reader in READERS.items() if reader.numbers])
def test_no_number_of_a_file_may_be_none_or_endless(name, tmp_path):
    """Each number in turn."""
    reader = READERS[name]
    path = reader.write(tmp_path)
    text = path.read_text()
    accepted = []
    for number in re.finditer(r"(?<![\w.+-])-?\d+(\.\d+)?([eE][+-]?\d+)?(?![\w.])", text):
        if reader.is_label(text, number.start()):
            continue
        for word in NOT_A_NUMBER.get(path.suffix, ("nan", "inf", "-inf")):
            path.write_text(text[: number.start()] + word + text[number.end() :])
            try:
                reader.read(path)
                accepted.append(f"{word} in {text[max(number.start() - 40, 0) : number.end()]!r}")
            except GsbridgeError:
                continue
    assert not accepted, f"{len(accepted)}: " + "\n".join(accepted[:20])


BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "\n".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 10)}]" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
HOSTILE = {
    "bomb": BOMB,
    "loop": "&a [*a]",
    "deep": "[" * 5000 + "]" * 5000,
    "python": "!!python/object/apply:os.system ['touch owned']",
    "records are a list": "model: model.yaml\nrecords: [fit.csv]",
    "model is a number": "model: 3\nrecords: {fit: fit.csv}",
    "noise is a list": "model: model.yaml\nrecords: {fit: fit.csv}\nnoise: [1]",
    "a device": "model: model.yaml\nrecords: {fit: /dev/zero}",
    "the whole disk": "model: model.yaml\nrecords: {fit: /usr}",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_cases_end_in_one_line(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write_case(tmp_path)
    path.write_text(HOSTILE[name])

    def read(path: Path) -> None:
        with contextlib.suppress(GsbridgeError):
            case_files(path)
        with pytest.raises(GsbridgeError):
            read_joint_case(path)

    read_within(Reader(write_case, read), path)
    assert not (tmp_path / "owned").exists()


def test_aliases_that_a_person_writes_are_read(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("a: &a {x: 1}\nb: *a\nc: [*a, *a]\n")
    assert load_yaml(path, "file", "-") == {"a": {"x": 1}, "b": {"x": 1}, "c": [{"x": 1}, {"x": 1}]}


def test_what_leads_a_library_astray_is_refused_and_a_slip_of_ours_is_not(tmp_path):
    def reader():
        if not tmp_path.exists():
            faces = 1
        return faces

    told = r"the mesh cannot be read \(cannot access local variable 'faces'"
    with pytest.raises(InputError, match=told), refusing(tmp_path, "the mesh cannot be read", "-"):
        reader()
    with pytest.raises(NameError), refusing(tmp_path, "the mesh cannot be read", "-"):
        exec("no_such_name", {"__name__": "gsbridge.somewhere"})


def test_half_a_photo_is_refused_and_a_whole_one_with_a_thumbnail_is_read(tmp_path):
    path = write_photo(tmp_path, "0.jpg")
    whole = path.read_bytes()
    thumbnail = b"\xff\xe1" + (len(whole) + 2).to_bytes(2, "big") + whole
    path.write_bytes(whole[:2] + thumbnail + whole[2:])
    assert read_image_u8(path).shape == (48, 64, 3)
    path.write_bytes((whole[:2] + thumbnail + whole[2:])[: -len(whole) // 3])
    with pytest.raises(GsbridgeError, match="cut off"):
        read_image_u8(path)


def test_a_picture_of_absurd_size_is_refused_before_it_is_decoded(tmp_path):
    path = write_photo(tmp_path, "0.png")
    data = bytearray(path.read_bytes())
    data[16:24] = (60_000).to_bytes(4, "big") * 2
    path.write_bytes(bytes(data))
    with pytest.raises(GsbridgeError):
        read_image_u8(path)


def test_a_phone_s_heif_is_read_and_turned_as_it_was_held():
    """64 x 48 px as stored, to be turned a quarter clockwise; red grows to the right and green downwards before the turn."""
    picture = read_image_u8(DATA / "turned.heic").astype(int)
    assert picture.shape == (64, 48, 3)
    assert picture[60, 24, 0] - picture[4, 24, 0] > 180
    assert picture[32, 4, 1] - picture[32, 44, 1] > 150


def test_a_folder_of_photos_may_hold_heif(tmp_path):
    (tmp_path / "a.HEIC").write_bytes(b"")
    assert [photo.path.name for photo in list_photos(tmp_path)] == ["a.HEIC"]
    assert Source("images", tmp_path).kind == "images"
