"""Hand-eye calibration and its refinement against synthetic captures of known truth."""

import numpy as np
import pytest
from board_sight import BOARD, CAMERA, shifted, sight, table_from_cameras
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.registration.fit import RegistrationViews, consistent, fit_views, leave_one_out, moved
from gsbridge.registration.handeye import HandEye, closed_form, start_hand_eye, turn_spread_deg
from gsbridge.registration.result import pose_error
from gsbridge.registration.sightings import sight_board


def views_of(capture):
    found = [sight_board(tags, BOARD, CAMERA, 1.5) for tags in capture.tags]
    return RegistrationViews.of(CAMERA, capture.base_from_flange, found)


def errors(found, capture):
    """Errors of mount and board: mm, degrees each."""
    pairs = (found.flange_from_camera, capture.flange_from_camera), (found.base_from_board, capture.base_from_board)
    return np.array([(1e3 * shift, np.rad2deg(turn)) for shift, turn in (pose_error(*pair) for pair in pairs)])


def test_a_photo_gives_the_boards_pose():
    capture = sight(0, noise_px=0.0)
    found = sight_board(capture.tags[0], BOARD, CAMERA, 1.5)
    truth = np.linalg.inv(capture.base_from_flange[0] @ capture.flange_from_camera) @ capture.base_from_board
    np.testing.assert_allclose(found.cam_from_board, truth, atol=1e-4)
    assert found.tags == 8


def test_a_misread_tag_is_left_out_and_too_few_are_refused():
    tags = dict(sight(0).tags[0])
    tags[3] = tags[3] + 25.0
    found = sight_board(tags, BOARD, CAMERA, 1.5)
    assert found.tags == 7
    assert found.rms_px < 0.3
    assert "2 of 8 tags" in sight_board({tag: tags[tag] for tag in (0, 1)}, BOARD, CAMERA, 1.5)
    assert "do not fit" in sight_board({tag: tags[(tag + 1) % 8] for tag in range(8)}, BOARD, CAMERA, 1.5)


@given(seed=st.integers(0, 10_000), count=st.integers(4, 9), scale=st.floats(0.8, 1.25))
@settings(max_examples=25, deadline=None)
def test_closed_form_is_exact_without_noise(seed, count, scale):
    rng = np.random.default_rng(seed)
    mount, board = (shifted(np.eye(4), rng, 0.5, 1.0) for _ in range(2))
    flanges = np.array([shifted(np.eye(4), rng, 0.5, 1.0) for _ in range(count)])
    seen = np.linalg.inv(flanges @ mount) @ board
    seen[:, :3, 3] /= scale
    found = closed_form(flanges, seen, with_scale=True)
    np.testing.assert_allclose(found.flange_from_camera, mount, atol=1e-6)
    np.testing.assert_allclose(found.base_from_board, board, atol=1e-6)
    assert found.scale == pytest.approx(scale, rel=1e-6)
    np.testing.assert_allclose(found.mismatch(flanges, seen), 0.0, atol=1e-6)


def test_fit_without_noise_finds_the_truth():
    capture = sight(1, noise_px=0.0)
    views = views_of(capture)
    fit = fit_views(views, HandEye(*(shifted(p, np.random.default_rng(0), 0.005, 0.02) for p in
                    (capture.flange_from_camera, capture.base_from_board))), with_scale=False)  # fmt: skip
    np.testing.assert_allclose(errors(fit.found, capture), 0.0, atol=1e-4)
    assert fit.rms_px < 1e-4


@pytest.mark.parametrize("with_scale", [False, True])
def test_fit_with_noise_is_as_good_as_it_says(with_scale):
    scale, ratios = 1.03 if with_scale else 1.0, []
    for seed in range(4):
        capture = sight(seed, scale=scale)
        views = views_of(capture)
        start = start_hand_eye(views.base_from_flange, views.cam_from_board, with_scale=with_scale, seed=0)
        fit, kept = consistent(views, start, with_scale=with_scale, floor_px=0.7, least=5)
        assert kept.all()
        assert fit.rms_px == pytest.approx(0.1 * np.sqrt(2), rel=0.2)
        found = errors(fit.found, capture)
        assert (found < [0.5, 0.06]).all()
        shifts = np.concatenate(
            [fit.found.flange_from_camera[:3, 3] - capture.flange_from_camera[:3, 3],
             fit.found.base_from_board[:3, 3] - capture.base_from_board[:3, 3]]
        )  # fmt: skip
        ratios.append(shifts / np.sqrt(np.diag(fit.covariance)[[0, 1, 2, 6, 7, 8]]))
        if with_scale:
            assert abs(fit.found.scale - scale) < 4 * np.sqrt(fit.covariance[12, 12]) * scale
    # 24 correlated standard normal values: their mean square is 1, give or take.
    assert 0.2 < np.mean(np.square(ratios)) < 3.0


def test_a_pose_beside_the_wrong_photo_is_found():
    capture = sight(2, count=14)
    # Two lines of the table exchanged.
    capture.base_from_flange[[3, 9]] = capture.base_from_flange[[9, 3]]
    views = views_of(capture)
    start = start_hand_eye(views.base_from_flange, views.cam_from_board, with_scale=False, seed=0)
    fit, kept = consistent(views, start, with_scale=False, floor_px=0.7, least=5)
    assert set(np.flatnonzero(~kept)) == {3, 9}
    assert (errors(fit.found, capture) < [0.5, 0.06]).all()


def test_leaving_out_sees_errors_of_the_arm_that_corners_do_not_tell():
    capture, rng = sight(3), np.random.default_rng(5)
    # Every pose of the arm is wrong by a millimetre or so.
    capture.base_from_flange = np.array([shifted(pose, rng, 0.001, 1e-4) for pose in capture.base_from_flange])
    views = views_of(capture)
    start = start_hand_eye(views.base_from_flange, views.cam_from_board, with_scale=False, seed=0)
    fit = fit_views(views, start, with_scale=False)
    without = leave_one_out(views, fit, with_scale=False)
    assert 5e-4 < np.sqrt((without.residuals_m**2).mean()) < 2.5e-3
    wrong = fit.found.base_from_board[:3, 3] - capture.base_from_board[:3, 3]
    assert np.linalg.norm(wrong) < 4 * np.sqrt(np.trace(without.covariance[6:9, 6:9]))
    assert np.trace(without.covariance[6:9, 6:9]) > np.trace(fit.covariance[6:9, 6:9])


def test_spread_of_turns_tells_degenerate_motion():
    rng = np.random.default_rng(0)
    good = turn_spread_deg(table_from_cameras(12, rng))
    flat = turn_spread_deg(table_from_cameras(12, rng, tilt=1e-3, turn=0.4))
    assert good[1] > 10
    assert flat[0] > 5
    assert flat[1] < 1


def test_a_step_moves_what_it_names():
    start = HandEye(np.eye(4), np.eye(4))
    step = np.zeros(13)
    step[[0, 8, 12]] = 0.1, 0.2, np.log(1.5)
    out = moved(start, step)
    np.testing.assert_allclose(out.flange_from_camera[:3, 3], [0.1, 0, 0])
    np.testing.assert_allclose(out.base_from_board[:3, 3], [0, 0, 0.2])
    assert out.scale == pytest.approx(1.5)
    np.testing.assert_array_equal(start.flange_from_camera, np.eye(4))
