"""The board's similarity where one tag's corners are wrong."""

from __future__ import annotations

import numpy as np
import pytest
from posed_scene import BOARD

from gsbridge.align import board_fit
from gsbridge.geometry import Array, Similarity, align_similarity


@pytest.mark.parametrize("seed", [309, 1052, 1391])
def test_a_tag_on_the_limit_is_left_out_for_good(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """Seven tags of which one is off. In each of these, another tag lies within the limit only while it is left out."""
    rng = np.random.default_rng(seed)
    count, bad = int(rng.integers(5, 9)), int(rng.integers(1, 3))
    noise, size = 10 ** rng.uniform(-4.5, -3.3), 10 ** rng.uniform(-3, -1.7)
    layout = np.array([corners for _, corners in sorted(BOARD.corners().items())])
    target = layout[np.sort(rng.choice(8, count, replace=False))]
    source = target + rng.normal(0, noise, (count, 1, 3)) + rng.normal(0, noise / 2, (count, 4, 3))
    source[rng.choice(count, bad, replace=False)] += rng.normal(0, size, (bad, 1, 3))
    fits = 0

    def counted(a: Array, b: Array) -> Similarity:
        nonlocal fits
        fits += 1
        assert fits <= count, "each fit but the last leaves out a tag"
        return align_similarity(a, b)

    monkeypatch.setattr(board_fit, "align_similarity", counted)
    found = board_fit._robust_similarity(source, target)
    # The truth is the identity, which the noise of the tags that are left moves by a few of its own sizes.
    assert found.scale == pytest.approx(1.0, abs=5 * noise / 0.1)
    assert np.linalg.norm(found.translation) < 5 * noise
