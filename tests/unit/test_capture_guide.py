"""Pictures of good and bad captures: each is what its line says, in the world of the mirror that it names."""

import functools

import numpy as np
import pytest

from gsbridge.cameras import camera_centre
from gsbridge.reality.world import camera as camera_module
from gsbridge.reality.world import capture_guide as module
from gsbridge.reality.world.capture_guide import BAD, EXAMPLES, GOOD, SEVERITY, WORLD, photo_of
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.severity import Severity, worsened


@pytest.fixture(scope="module")
def photos():
    hidden = worsened(Hidden.draw(WORLD), WORLD, Severity(look=SEVERITY))
    small = pytest.MonkeyPatch()
    small.setattr(module, "WIDTH", 160)
    small.setattr(module, "HEIGHT", 120)
    # Painting the table takes as long as a photo, and all show the same one.
    small.setattr(camera_module, "table_texture", functools.cache(camera_module.table_texture))
    yield {example.text.split(":")[0]: photo_of(example, hidden, 1, 8, k) for k, example in enumerate(EXAMPLES)}
    small.undo()


def red(picture):
    return int(((picture[..., 0] > 100) & (picture[..., 1] < 70)).sum())


def steps(picture):
    """Mean step of the grey level from pixel to pixel, within the lower half, where the board lies."""
    grey = picture[60:].mean(-1) / picture[60:].mean()
    return np.abs(np.diff(grey, axis=1)).mean()


def test_each_picture_is_what_its_line_says(photos):
    assert {picture.shape for picture in photos.values()} == {(120, 160, 3)}
    first = photos["first round"]
    assert red(first) > 20
    assert red(photos["the table alone, from higher and wider"]) == 0
    assert red(photos["too near"]) > 5 * red(first)
    assert red(photos["too far"]) < 0.4 * red(first)
    assert photos["too dark"].mean() < 0.3 * first.mean()
    assert steps(photos["moved too fast"]) < 0.7 * steps(first)
    # Paper is the brightest thing on the table.
    assert (photos["no board"].mean(-1) > 170).mean() < 0.01 < (first.mean(-1) > 170).mean()


def test_eyes_stand_where_they_are_said_to():
    for example in EXAMPLES:
        poses = example.poses()
        assert len(poses) == (9 if example.blur_deg else 1)
        for pose in poses:
            eye = camera_centre(pose) - np.array(example.aim or (module.SPOT[0], 0.66 * module.SPOT[1], 0.02))
            assert np.linalg.norm(eye) == pytest.approx(example.distance)
            assert np.degrees(np.arcsin(eye[2] / np.linalg.norm(eye))) == pytest.approx(example.elevation_deg)
    assert sum(example.good for example in EXAMPLES) == 3
    assert GOOD != BAD
