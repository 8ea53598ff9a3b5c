"""A known length beside another source of the scale, on a scene whose unit is known."""

from __future__ import annotations

from pathlib import Path

import pytest
from posed_scene import cloud
from test_align import AWAY, between, run, write_scene

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
