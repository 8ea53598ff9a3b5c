"""A known length beside another source of the scale, on a scene whose unit is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from posed_scene import cloud
from test_align import AWAY, PINHOLE, POSES, between, run, write_scene

from gsbridge.align import AlignSettings
from gsbridge.align.length import table_point

METRES_PER_UNIT = 1.0 / AWAY.scale


@pytest.mark.parametrize(("wrong", "said"), [(1.0, False), (1.02, False), (0.94, True), (10.0, True)])
def test_a_known_length_that_contradicts_the_unit_of_the_poses_is_told(tmp_path: Path, wrong: float, said: bool) -> None:
    paths = write_scene(tmp_path, cloud())
    length = between(0.2, (3, 0.1, 0.0), (9, -0.1, 0.0))
    record = run(paths, board=False, known_length=length, metres_per_unit=wrong * METRES_PER_UNIT)
    assert record["scale"] == pytest.approx(wrong * METRES_PER_UNIT, rel=1e-9)
    text = f"makes lengths {100 / wrong:.0f} % of what `metres_per_unit` makes them"
    assert [text in reason for reason in record["reasons"]] == [True] * said
    assert record["status"] == ("degraded" if said else "pass")


def test_the_longest_side_does_not_check_the_unit_of_the_poses(tmp_path: Path) -> None:
    length = {"metres": 0.6, "object": "longest"}
    record = run(write_scene(tmp_path, cloud()), board=False, known_length=length, metres_per_unit=METRES_PER_UNIT)
    assert record["status"] == "pass"


@pytest.mark.parametrize(("half", "status"), [(0.1, "pass"), (0.05, "degraded")])
@pytest.mark.parametrize("turn", [0.0, 0.8, 1.6])
def test_two_points_may_leave_the_scale_unsure_by_one_percent(tmp_path: Path, half: float, status: str, turn: float) -> None:
    """Twice what a board may, by the scatter of lengths read off the photo with an error of a pixel in each coordinate."""
    ends = half * np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.cos(turn), -np.sin(turn), 0.0]])
    length = between(2 * half, *((9, *end[:2]) for end in ends))
    record = run(write_scene(tmp_path, cloud()), board=False, known_length=length)
    rng = np.random.default_rng(0)
    read = np.array([pixel[1:] for pixel in length["between"]]) + rng.normal(0, 1, (1000, 2, 2))
    points = np.array([[table_point(pixel, PINHOLE, POSES[9]) for pixel in pair] for pair in read])
    scatter = np.std(np.linalg.norm(points[:, 0] - points[:, 1], axis=1)) / (2 * half)
    assert record["scale_se"] / record["scale"] == pytest.approx(scatter, rel=0.15)
    assert scatter > AlignSettings().max_scale_se
    assert record["status"] == status
