"""Start poses: inside, repeatable, disjoint and evenly spread."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.errors import InputError
from gsbridge.tasks.poses import PER_QUADRANT, POSE_SETS, KeepOut, StartRegion, pose_set, sets_of

REGION = StartRegion()
PLATE = StartRegion(keep_out=(KeepOut(0.0, 0.265, 0.12),))


def cells(poses, region, per_side):
    return np.floor((poses[:, :2] - region.centre + region.side / 2) / region.side * per_side).astype(int)


@pytest.mark.parametrize("region", [REGION, PLATE, StartRegion(centre=(1.0, -2.0), side=0.2, yaw=(0.0, 1.0))])
@pytest.mark.parametrize("name", POSE_SETS[:2])
def test_sets_have_eight_poses_per_quadrant_inside_the_region(name, region):
    poses = pose_set(name, region)
    assert poses.shape == (32, 3)
    assert region.free(poses[:, :2]).all()
    np.testing.assert_array_equal(region.quadrant(poses[:, :2]), np.repeat([1, 2, 3, 4], PER_QUADRANT))
    for quadrant in range(4):
        yaw = poses[8 * quadrant : 8 * quadrant + 8, 2]
        bins = np.floor((yaw - region.yaw[0]) / (region.yaw[1] - region.yaw[0]) * 8).astype(int)
        assert sorted(bins) == list(range(8))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_sets_are_repeatable_disjoint_and_cover_every_row_and_column(seed):
    fixed, unseen = (pose_set(name, REGION, seed) for name in POSE_SETS[:2])
    np.testing.assert_array_equal(fixed, pose_set("fixed", REGION, seed))
    distances = np.linalg.norm(fixed[:, None, :2] - unseen[None, :, :2], axis=-1)
    # Cells of 37.5 mm with 8 % of border on each side: neighbours of the other set stay 6 mm away.
    assert distances.min() > 0.0059
    both = np.concatenate([cells(fixed, REGION, 8), cells(unseen, REGION, 8)])
    assert len(np.unique(both, axis=0)) == 64
    for poses in (fixed, unseen):
        for axis in (0, 1):
            np.testing.assert_array_equal(np.bincount(cells(poses, REGION, 8)[:, axis]), np.full(8, 4))


def test_another_seed_gives_other_poses():
    assert np.abs(pose_set("fixed", REGION, 0) - pose_set("fixed", REGION, 1)).max() > 1e-3


def test_a_disc_moves_only_the_poses_it_covers():
    free, kept = pose_set("fixed", REGION), pose_set("fixed", PLATE)
    stay = PLATE.free(free[:, :2])
    untouched = np.isclose(free[:, :2], kept[:, :2], atol=1e-12).all(1)
    assert stay[~untouched].sum() == 0
    assert 0 < untouched.sum() < 32
    np.testing.assert_array_equal(free[:, 2], kept[:, 2])
    other = pose_set("unseen", PLATE)
    assert np.linalg.norm(kept[:, None, :2] - other[None, :, :2], axis=-1).min() > 0.0059


def test_samples_are_uniform_and_repeatable():
    poses = REGION.sample(np.random.default_rng(0), 20_000)
    np.testing.assert_array_equal(poses[:8], REGION.sample(np.random.default_rng(0), 20_000)[:8])
    counts = np.bincount(cells(poses, REGION, 4) @ [4, 1], minlength=16)
    expected = len(poses) / 16
    # Chi-squared with 15 degrees of freedom stays below 37.7 in 99.9 % of seeds.
    assert ((counts - expected) ** 2 / expected).sum() < 37.7
    assert np.abs(poses[:, 2]).max() <= np.pi / 4
    assert np.corrcoef(poses.T)[0, 1] == pytest.approx(0.0, abs=0.03)


def test_samples_keep_out_of_discs():
    poses = PLATE.sample(np.random.default_rng(0), 500)
    assert (np.hypot(poses[:, 0], poses[:, 1] - 0.265) >= 0.12).all()
    assert PLATE.sample(np.random.default_rng(0), 0).shape == (0, 3)


def test_samples_come_from_every_quadrant_equally_often_however_little_room_a_plate_leaves():
    tight = StartRegion(side=0.33, keep_out=(KeepOut(0.016, 0.289, 0.1675),))
    poses = tight.sample(np.random.default_rng(0), 4000)
    assert tight.free(poses[:, :2]).all()
    counts = np.bincount(tight.quadrant(poses[:, :2]), minlength=5)[1:]
    np.testing.assert_allclose(counts, 1000, atol=90)  # more than three standard deviations


def test_quadrants_are_numbered_as_in_the_paper():
    centre = np.array(REGION.centre)
    offsets = np.array([[0.1, -0.1], [0.1, 0.1], [-0.1, -0.1], [-0.1, 0.1], [0.0, 0.0]])
    np.testing.assert_array_equal(REGION.quadrant(centre + offsets), [1, 2, 3, 4, 2])


def test_bad_regions_are_named():
    covered = StartRegion(keep_out=(KeepOut(0.0, 0.265, 0.3),))
    for call in (lambda: pose_set("fixed", covered), lambda: covered.sample(np.random.default_rng(0), 1)):
        with pytest.raises(InputError, match="no free place"):
            call()
    with pytest.raises(InputError, match="'seen' is unknown"):
        pose_set("seen", REGION)
    for bad in ({"side": 0.0}, {"side": float("nan")}, {"yaw": (1.0, 0.0)}):
        with pytest.raises(InputError, match="start region"):
            StartRegion(**bad)


def test_a_plate_that_leaves_a_corner_only_still_leaves_both_sets_their_places():
    """The mirror's plate with the cake beside it: of quadrant 2 a corner of 2 cm2 is left, in cells of one colour."""
    tight = StartRegion(keep_out=(KeepOut(0.016, 0.289, 0.1675),))
    for name in POSE_SETS[:2]:
        poses = pose_set(name, tight)
        assert tight.free(poses[:, :2]).all()
        np.testing.assert_array_equal(tight.quadrant(poses[:, :2]), np.repeat([1, 2, 3, 4], PER_QUADRANT))
        assert len(np.unique(poses[:, :2], axis=0)) == len(poses)


def test_poses_outside_lie_between_the_square_and_what_the_tool_reaches():
    region = StartRegion()
    poses = pose_set("outside", region)
    assert poses.shape == (32, 3)
    away = np.abs(poses[:, :2] - region.centre).max(1)
    assert away.min() > 0.15
    assert away.max() <= 0.165
    assert (region.quadrant(poses[:, :2]) == np.repeat([1, 2, 3, 4], 8)).all()
    # All round: no two poses on one spot.
    apart = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=-1) + np.eye(32)
    assert apart.min() > 0.004
    assert (pose_set("outside", region, 1) != poses).any()
    assert sets_of(region) == POSE_SETS
    # Placing takes all that the tool reaches.
    assert sets_of(StartRegion(side=0.33)) == ("fixed", "unseen")
    with pytest.raises(InputError, match="unknown here"):
        pose_set("outside", StartRegion(side=0.33))
