"""What phones write into their videos: how they were held, and a frame rate that changes."""

import struct

import cv2
import numpy as np
import pytest
from film_maker import write_video

from gsbridge.capture.sources import Video

BOXES = (b"moov", b"trak", b"mdia", b"minf", b"stbl")
"""Boxes around the table of times, outermost first."""


@pytest.fixture
def film(tmp_path):
    """Ten frames of 64 x 48 px, red on the left and blue on the right, a tenth of a second each."""
    frame = np.zeros((48, 64, 3), np.uint8)
    frame[:, :32, 2], frame[:, 32:, 0] = 200, 200
    return write_video(tmp_path / "film.mp4", [frame] * 10, fps=10.0)


def test_a_video_is_turned_as_it_was_held(film):
    """Its file says: turn a quarter clockwise. What was left is up then."""
    data = bytearray(film.read_bytes())
    place = data.index(b"tkhd") + 4 + 40
    one = 1 << 16
    data[place : place + 36] = struct.pack(">9i", 0, one, 0, -one, 0, 0, 48 * one, 0, 1 << 30)
    film.write_bytes(bytes(data))
    _, frame = next(iter(Video(film)))
    assert frame.shape == (64, 48, 3)
    top, bottom = frame[8, 24].astype(int), frame[56, 24].astype(int)
    assert top[2] - top[0] > 100
    assert bottom[0] - bottom[2] > 100


def test_frames_of_a_changing_rate_have_their_own_times(film):
    """Five frames of 0.1 s, then five of 0.4 s."""
    data = bytearray(film.read_bytes())
    table = data.index(b"stts")
    (count,) = struct.unpack_from(">I", data, table + 8)
    assert count == 1
    number, step = struct.unpack_from(">II", data, table + 12)
    assert number == 10
    data[table + 8 : table + 20] = struct.pack(">5I", 2, 5, step, 5, 4 * step)
    for name in BOXES:
        _lengthen(data, data.index(name), 8)
    _lengthen(data, table, 8)
    # The film is longer now; frames beyond its stated length would be cut.
    length = data.index(b"elst") + 12
    struct.pack_into(">I", data, length, struct.unpack_from(">I", data, length)[0] * 5 // 2)
    film.write_bytes(bytes(data))
    times = [time for time, _ in Video(film)]
    assert times == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.9, 1.3, 1.7, 2.1], abs=0.03)


def _lengthen(data, place, count):
    struct.pack_into(">I", data, place - 4, struct.unpack_from(">I", data, place - 4)[0] + count)


def test_frames_of_an_even_rate_have_their_numbers_times(film):
    assert [time for time, _ in Video(film)] == [number / 10.0 for number in range(10)]
    assert cv2.VideoCapture(str(film)).get(cv2.CAP_PROP_FPS) == 10.0
