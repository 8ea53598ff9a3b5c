"""States that two worlds share, and the comparison of what their cameras show."""

import csv

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.images import write_image
from gsbridge.report.figures.eye_in_hand import COMPARED, Looked, write_eye_in_hand
from gsbridge.tasks.views import ViewState, read_states, write_states


def test_states_come_back_as_they_were_written(tmp_path):
    rng = np.random.default_rng(0)
    states = [ViewState(rng.normal(size=7), 0.1 * k, rng.normal(size=3), k, 3 * k) for k in range(3)]
    write_states(tmp_path / "states.json", states, "fixed")
    for one, two in zip(states, read_states(tmp_path / "states.json"), strict=True):
        np.testing.assert_array_equal(one.q, two.q)
        np.testing.assert_array_equal(one.object_pose, two.object_pose)
        assert (one.aperture, one.start, one.step) == (two.aperture, two.start, two.step)
    (tmp_path / "bad.json").write_text('{"states": [{"q": [1, 2]}]}')
    with pytest.raises(InputError, match="holds no states"):
        read_states(tmp_path / "bad.json")


def test_psnr_is_that_of_the_known_error(tmp_path):
    errors = {"gs": 0.1, "gs_unshaded": 0.15, "mesh_vertex_shaded": 0.18, "mesh_vertex": 0.2, "mesh_shaded": 0.3, "mesh": 0.4}
    for index in range(3):
        write_image(tmp_path / "photos" / f"{index:02d}.png", np.full((16, 16, 3), 0.2, np.float32))
        for name in COMPARED:
            write_image(tmp_path / "drawn" / f"{index:02d}_{name}.png", np.full((16, 16, 3), 0.2 + errors[name], np.float32))
    pair = Looked("cake", "plate", tmp_path / "drawn", tmp_path / "photos")
    write_eye_in_hand([pair], tmp_path / "figure.png", tmp_path / "rows.csv")
    assert (tmp_path / "figure.png").stat().st_size > 5_000
    rows = list(csv.DictReader((tmp_path / "rows.csv").open()))
    assert [row["renderer"] for row in rows] == list(COMPARED)
    for row in rows:
        assert (row["object"], row["background"], row["views"]) == ("cake", "plate", "3")
        # Eight bits move an error of 0.1 by up to 2 %.
        assert float(row["psnr"]) == pytest.approx(-20 * np.log10(errors[row["renderer"]]), abs=0.2)
    (tmp_path / "drawn" / "01_gs.png").unlink()
    with pytest.raises(InputError, match="01_gs"):
        write_eye_in_hand([pair], tmp_path / "figure.png", tmp_path / "rows.csv")
    with pytest.raises(InputError, match="nothing to compare"):
        write_eye_in_hand([], tmp_path / "figure.png", tmp_path / "rows.csv")
