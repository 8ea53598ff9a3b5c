"""Harmonics gain on a glossy ball and do not lose on a matt one."""

from __future__ import annotations

from pathlib import Path

from ball_scene import held_out, targets


def test_degree_1_gains_on_a_glossy_ball(tmp_path: Path) -> None:
    photos = targets(sheen=0.35)
    assert held_out(photos, tmp_path, degree=1)[0] > held_out(photos, tmp_path)[0] + 0.5


def test_degree_1_loses_nothing_on_a_matt_ball(tmp_path: Path) -> None:
    photos = targets(sheen=0.0)
    assert held_out(photos, tmp_path, degree=1)[0] > held_out(photos, tmp_path)[0] - 0.1
