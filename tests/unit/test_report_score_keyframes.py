"""Scores of chosen keyframes, on choices whose quality is known by construction."""

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.report.scores.keyframes import keyframe_scores, write_keyframe_score

MOTION = np.r_[0, 0, 0, np.full(27, 2.0)]
SHAKEN = np.arange(30) % 3 == 1


def test_even_sharp_choice_scores_perfectly():
    chosen = [2, 5, 8, 11, 14, 17]
    scores = keyframe_scores(chosen, np.r_[0, np.full(5, 3.0)], MOTION, SHAKEN)
    assert scores["blurred_chosen_percent"] == 0
    assert scores["blurred_film_percent"] == pytest.approx(100 / 3)
    assert scores["motion_scale"] == pytest.approx(0.5)
    assert scores["motion_error_percent"] == pytest.approx(0, abs=1e-9)
    assert scores["step_spread"] == pytest.approx(0, abs=1e-9)
    assert scores["still_chosen"] == 1


def test_uneven_blurred_choice_is_named():
    scores = keyframe_scores([0, 1, 4, 5, 25], np.array([0, 0, 4.0, 2.0, 40.0]), MOTION, SHAKEN)
    assert scores["blurred_chosen_percent"] == pytest.approx(60)
    assert scores["still_chosen"] == 2
    assert scores["step_spread"] > 1


def test_record_is_written_and_another_film_is_refused(tmp_path):
    frames = [{"motion_px": float(m), "blurred": bool(b)} for m, b in zip(MOTION, SHAKEN, strict=True)]
    write_json(tmp_path / "truth.json", {"frames": frames})
    chosen = [{"index": i, "motion_px": 6.0} for i in (2, 5, 8)]
    write_json(tmp_path / "keyframes.json", {"decoded": 30, "frames": chosen})
    write_keyframe_score(tmp_path / "out.json", keyframes_json=tmp_path / "keyframes.json", truth_json=tmp_path / "truth.json")
    assert read_json(tmp_path / "out.json")["keyframes"] == 3
    write_json(tmp_path / "truth.json", {"frames": [{"name": "0000.png"}] * 30})
    with pytest.raises(InputError, match=r"truth\.json.*motion"):
        write_keyframe_score(
            tmp_path / "out.json", keyframes_json=tmp_path / "keyframes.json", truth_json=tmp_path / "truth.json"
        )
