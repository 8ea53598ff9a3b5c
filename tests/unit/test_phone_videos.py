"""What phones write into their videos: how they were held, and a frame rate that changes."""

import shutil
import struct
import subprocess
from functools import cache

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


@cache
def encoders():
    """What ffmpeg can write; nothing where there is none."""
    if shutil.which("ffmpeg") is None:
        return ""
    return subprocess.run(["ffmpeg", "-hide_banner", "-encoders"], capture_output=True, text=True, check=True).stdout


def encode(path, encoder, *options, pixels="yuv420p"):
    """Twenty frames of 192 x 144 px, 0.1 s each, red on the left and blue on the right; a white bar goes to the right.

    Args:
        path: Video to be written; its suffix tells the container.
        encoder: Of ffmpeg.
        options: Of ffmpeg, for the output.
        pixels: Format of the pixels in the file.
    """
    if f" {encoder} " not in encoders():
        pytest.skip(f"needs ffmpeg with {encoder}")
    frames = np.zeros((20, 144, 192, 3), np.uint8)
    frames[:, :, :96, 2], frames[:, :, 96:, 0] = 200, 200
    for number, frame in enumerate(frames):
        frame[64:80, 8 * number : 8 * number + 8] = 255
    command = ["ffmpeg", "-v", "error", "-f", "rawvideo", "-pix_fmt", "bgr24", "-s", "192x144", "-r", "10", "-i", "-"]
    command += [*options, "-c:v", encoder, "-pix_fmt", pixels, "-threads", "1", str(path)]
    subprocess.run(command, input=frames.tobytes(), check=True, capture_output=True)
    return path


def bar(frame):
    """Where the bar is, px from the left of the upright frame."""
    bright = np.flatnonzero(frame[68:76].min(axis=(0, 2)) > 150)
    return float(bright.mean())


@pytest.mark.parametrize(
    ("encoder", "pixels", "options"),
    [
        ("libx264", "yuv420p", ("-bf", "2")),
        # As iPhones write it, with and without HDR: ten bits, and frames that are stored in another order than shown.
        ("libx265", "yuv420p", ("-tag:v", "hvc1", "-x265-params", "log-level=none:bframes=3:pools=1")),
        ("libx265", "yuv420p10le", ("-tag:v", "hvc1", "-x265-params", "log-level=none:bframes=3:pools=1")),
    ],
)
def test_every_frame_of_what_phones_encode_is_read_in_order(tmp_path, encoder, pixels, options):
    video = Video(encode(tmp_path / "film.mov", encoder, *options, pixels=pixels))
    found = list(video)
    assert video.declared == len(found) == 20
    assert [time for time, _ in found] == pytest.approx([number / 10 for number in range(20)])
    assert [bar(frame) for _, frame in found] == pytest.approx([8 * number + 3.5 for number in range(20)], abs=2)
    left, right = found[0][1][20, 48].astype(int), found[0][1][20, 144].astype(int)
    assert (left[2] - left[0] > 120, right[0] - right[2] > 120) == (True, True)


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_video_that_ffmpeg_marks_as_turned_is_upright(tmp_path, degrees):
    """The stored frames lie on their side, and the file says by how much; what is upright, ffmpeg itself says."""
    stored = encode(tmp_path / "stored.mp4", "libx264")
    marked, upright = tmp_path / "marked.mp4", tmp_path / "upright.mkv"
    for command in (
        ["-i", stored, "-c", "copy", "-metadata:s:v:0", f"rotate={degrees}", marked],
        ["-i", marked, "-c:v", "ffv1", "-threads", "1", upright],
    ):
        subprocess.run(["ffmpeg", "-v", "error", *map(str, command)], check=True, capture_output=True)
    ours = [frame for _, frame in Video(marked)]
    theirs = [frame for _, frame in Video(upright)]
    assert ours[0].shape == ((144, 192, 3) if degrees == 180 else (192, 144, 3))
    if np.array_equal(theirs[0].shape, (144, 192, 3)) and degrees != 180:
        pytest.skip("needs ffmpeg with the old mark of rotation: this one did not write it")
    assert len(ours) == len(theirs) == 20
    assert np.abs(ours[5].astype(int) - theirs[5].astype(int)).mean() < 3


def test_times_of_a_changing_rate_are_those_that_ffmpeg_wrote(tmp_path):
    """Ten frames of 0.1 s, then ten of 0.3 s, as a phone does that saves light."""
    times = "if(lt(N,10),N*0.1,1+(N-10)*0.3)/TB+0.01"
    video = encode(tmp_path / "film.mp4", "libx264", "-vf", f"setpts='{times}'", "-vsync", "vfr", "-bf", "2")
    wanted = [number * 0.1 for number in range(10)] + [1 + number * 0.3 for number in range(10)]
    found = list(Video(video))
    assert [time for time, _ in found] == pytest.approx(wanted, abs=1e-3)
    assert [bar(frame) for _, frame in found] == pytest.approx([8 * number + 3.5 for number in range(20)], abs=2)
