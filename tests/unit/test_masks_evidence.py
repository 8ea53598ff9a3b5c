"""Masks against measured points, which were found without any mask."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from solid_scene import around, pot, solid_scene, statue, traced

from gsbridge.cameras import Camera
from gsbridge.masks.evidence import doubts, lost_parts, lost_points, mended, missed_points, reached, surely_placed
from gsbridge.masks.layers import grown
from gsbridge.masks.seen_past import seen_past
from gsbridge.mesh.hull import build_hull
from gsbridge.photogrammetry.sparse import SparsePoints, read_points

CAMERA = Camera(240, 180, 280.0, 280.0, 120.0, 90.0)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    views = around(CAMERA, 14, (35.0,), np.array([0.0, 0.0, 0.025]))
    made = solid_scene(tmp_path_factory.mktemp("pot"), pot, views, points=60)
    return views, [mask.astype(np.float32) for mask in made.inside], read_points(made.points_npz)


def members_of(sparse):
    return sparse.points[:, 2] > 0.003


def missed_by(scene, masks):
    views, _, sparse = scene
    return missed_points(views, masks, sparse, members_of(sparse), np.flatnonzero(np.abs(sparse.points[:, 2]) < 0.001))


def bite(view, mask):
    """The mask without the lowest fifth of the pot, as a dark foot over its own shadow comes out."""
    foot = traced(view, pot)[0][..., 2] < 0.012
    return np.where(foot, 0.0, mask).astype(np.float32)


def hulls(views, masks):
    def hull_of(chosen):
        parts = [views[i] for i in chosen], [masks[i] for i in chosen]
        return build_hull(*parts, vote=0.95, voxels=64, width=240, threads=1).mesh

    return hull_of


def overlap(first, second):
    first, second = first > 0.5, second > 0.5
    return (first & second).sum() / (first | second).sum()


def test_sound_masks_miss_nothing_and_stay(scene):
    views, masks, sparse = scene
    members = members_of(sparse)
    missed = missed_by(scene, masks)
    assert max(item.share for item in missed) < 0.03
    assert doubts(missed, [view.name for view in views]) == []
    same = mended(views, masks, sparse, members, missed, hulls(views, masks))
    assert all(one is other for one, other in zip(same, masks, strict=True))


def test_bites_in_a_few_masks_are_filled_from_the_others(scene):
    views, masks, sparse = scene
    bitten = [
        bite(view, mask) if index in (2, 7, 8) else mask for index, (view, mask) in enumerate(zip(views, masks, strict=True))
    ]
    members = members_of(sparse)
    missed = missed_by(scene, bitten)
    assert [index for index, item in enumerate(missed) if item.bitten] == [2, 7, 8]
    (reason,) = doubts(missed, [view.name for view in views])
    assert "3 of 14 masks" in reason
    assert "its foot" in reason
    whole = mended(views, bitten, sparse, members, missed_by(scene, bitten), hulls(views, bitten))
    for index in (2, 7, 8):
        assert overlap(bitten[index], masks[index]) < 0.93
        assert overlap(whole[index], masks[index]) > 0.96
    assert doubts(missed_by(scene, whole), [view.name for view in views]) == []


def test_masks_that_all_lack_the_foot_agree_and_are_doubted(scene):
    views, masks, sparse = scene
    bitten = [bite(view, mask) for view, mask in zip(views, masks, strict=True)]
    members = members_of(sparse)
    same = mended(views, bitten, sparse, members, missed_by(scene, bitten), hulls(views, bitten))
    assert all(one is other for one, other in zip(same, bitten, strict=True))
    assert len(doubts(missed_by(scene, bitten), [view.name for view in views])) == 1


def test_measured_points_bring_back_a_foot_that_all_masks_lack(scene, tmp_path):
    views, masks, _ = scene
    sparse = read_points(solid_scene(tmp_path, pot, list(views), points=200).points_npz)
    members = members_of(sparse)
    assert not lost_points(views, masks, sparse, members).any()
    bitten = [bite(view, mask) for view, mask in zip(views, masks, strict=True)]
    lost = lost_points(views, bitten, sparse, members)
    # All but those that lie right below the bite's edge.
    assert lost[members & (sparse.points[:, 2] < 0.01)].mean() > 0.95
    assert not lost[sparse.points[:, 2] > 0.013].any()
    for view, mask, part in list(zip(views, masks, bitten, strict=True))[:4]:
        pixels = view.camera.project(sparse.points[lost] @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3])
        whole = reached(part > 0.5, pixels)
        assert overlap(part, mask) < 0.93
        assert overlap(whole, mask) > 0.965
        # Nothing is added that is not the object's, nor for lone points.
        assert (whole & (mask < 0.5)).sum() < 0.01 * mask.sum()
        assert reached(mask > 0.5, np.array([[5.0, 5.0], [200.0, 160.0], [np.nan, 3.0]])).sum() == mask.sum()


def test_a_thin_part_that_all_masks_lack_is_said(scene):
    """Eight points up a rod on the pot's rim are too few of any photo's for its mask to count as bitten."""
    views, masks, sparse = scene
    rod = np.c_[np.full(8, 0.03), np.zeros(8), np.linspace(0.06, 0.075, 8)]
    start, everywhere = len(sparse.points), np.repeat(np.arange(len(views)), 8)
    with_rod = SparsePoints(
        np.concatenate([sparse.points, rod]),
        np.concatenate([sparse.view_index, everywhere]),
        np.concatenate([sparse.point_index, np.tile(start + np.arange(8), len(views))]),
    )
    members = members_of(with_rod)
    (reason,) = lost_parts(views, masks, with_rod, members)
    assert "in one place" in reason
    assert lost_parts(views, masks, sparse, members_of(sparse)) == []


def with_points(sparse, added, seen_in):
    """The sparse model with more points, each seen in its own photos."""
    start = len(sparse.points)
    return SparsePoints(
        np.concatenate([sparse.points, added]),
        np.concatenate([sparse.view_index, *map(np.asarray, seen_in)]),
        np.concatenate([sparse.point_index, *(np.full(len(seen), start + index) for index, seen in enumerate(seen_in))]),
    )


def behind(view, point, count, rng):
    """Points of the table that a photo shows within a pixel of a point which stands before them."""
    aside = rng.normal(0, 5e-4, (count, 3))
    rays = point + aside - view.centre
    return view.centre + rays * (-view.centre[2] / rays[:, 2:])


def test_points_that_photos_look_past_are_no_part(scene):
    """Ends of edges where the outline crosses the table's pattern, beside the foot, in a few photos that agree on each."""
    views, masks, sparse = scene
    angle = np.linspace(0.0, 0.4, 8)
    ends = np.c_[0.032 * np.cos(angle), 0.032 * np.sin(angle), np.full(8, 0.006)]
    few = [[index % 4, index % 4 + 1, 12, 13] for index in range(8)]
    plain = with_points(sparse, ends, few)
    members = np.append(members_of(sparse), np.ones(8, bool))
    # On a table without a pattern they could be a part of its colour.
    (reason,) = lost_parts(views, masks, plain, members)
    assert "in one place" in reason
    rng = np.random.default_rng(2)
    table = [(behind(view, point, 1, rng), number) for number, view in enumerate(views) for point in ends]
    patterned = with_points(plain, np.concatenate([at for at, _ in table]), [[number] for _, number in table])
    members = np.append(members, np.zeros(len(table), bool))
    assert lost_parts(views, masks, patterned, members) == []


def test_a_lost_plinth_hides_the_table_behind_it_and_is_said(tmp_path):
    views = around(CAMERA, 14, (35.0,), np.array([0.0, 0.0, 0.04]))
    made = solid_scene(tmp_path, statue, views, points=200)
    sparse, whole = read_points(made.points_npz), [mask.astype(np.float32) for mask in made.inside]
    members = members_of(sparse)
    assert lost_parts(views, whole, sparse, members) == []
    bare = [
        np.where(traced(view, statue)[0][..., 2] < 0.0165, 0.0, mask).astype(np.float32)
        for view, mask in zip(views, whole, strict=True)
    ]
    (reason,) = lost_parts(views, bare, sparse, members)
    assert "a part is missing" in reason
    lost = np.flatnonzero(lost_points(views, bare, sparse, members, 0.015))
    assert seen_past(views, bare, sparse, lost, 0.015, 0.1).mean() < 0.05


@pytest.mark.parametrize("kept", [0, 11, 60])
def test_masks_that_hold_the_table_are_told_however_few_points_the_object_has(tmp_path, kept):
    """A plain thing has few points of its own; a mask that swallows its shadow holds the table's all the same."""
    views = around(CAMERA, 10, (35.0,), np.array([0.0, 0.0, 0.04]))
    made = solid_scene(tmp_path, statue, views, points=200)
    sparse, masks = read_points(made.points_npz), [mask.astype(np.float32) for mask in made.inside]
    members = members_of(sparse) & (np.cumsum(members_of(sparse)) <= kept)
    spots = np.random.default_rng(1).uniform([0.05, -0.03, 0.0], [0.11, 0.03, 0.0], (60, 3))
    crowded = with_points(sparse, spots, [list(range(len(views)))] * len(spots))
    table = np.arange(len(sparse.points), len(crowded.points))
    members = np.append(members, np.zeros(len(spots), bool))
    names = [view.name for view in views]
    assert doubts(missed_points(views, masks, crowded, members, table), names) == []
    shadow = [np.maximum(mask, around_points(view, spots)) for view, mask in zip(views, masks, strict=True)]
    assert any("measured on the table" in line for line in doubts(missed_points(views, shadow, crowded, members, table), names))


def around_points(view, points):
    """A mask of all that lies between points of the table. [H, W]."""
    pixels = view.camera.project(points @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3]).astype(np.float32)
    out = np.zeros((view.camera.height, view.camera.width), np.uint8)
    cv2.fillConvexPoly(out, cv2.convexHull(pixels).astype(np.int32), 1)
    return grown(out > 0, 6).astype(np.float32)


def test_photos_from_one_side_place_no_point_surely(scene):
    """Their table rises beside the object, and would be taken for it."""
    views, _, sparse = scene
    assert surely_placed(views, sparse)[members_of(sparse)].mean() > 0.8
    # A shelf behind, on which most points lie, changes nothing.
    shelf = np.random.default_rng(4).uniform([1.8, -1.0, 0.0], [2.0, 1.0, 1.0], (4 * len(sparse.points), 3))
    crowded = with_points(sparse, shelf, [[0, 1]] * len(shelf))
    found = surely_placed(views, crowded)[: len(sparse.points)]
    np.testing.assert_array_equal(found, surely_placed(views, sparse))
    arc = sparse.view_index < 5
    few = replace(sparse, view_index=sparse.view_index[arc], point_index=sparse.point_index[arc])
    assert not surely_placed(views[:5], few).any()


def test_points_that_no_photo_shows_where_masks_leave_them_out_are_lost_too(scene):
    """Three of fourteen photos lose the foot, and no match reaches it in them: a hull of all masks would lose it."""
    views, masks, sparse = scene
    few = (2, 7, 8)
    bitten = [bite(view, mask) if index in few else mask for index, (view, mask) in enumerate(zip(views, masks, strict=True))]
    foot = sparse.points[:, 2] < 0.01
    unseen = np.isin(sparse.view_index, few) & foot[sparse.point_index]
    blind = replace(sparse, view_index=sparse.view_index[~unseen], point_index=sparse.point_index[~unseen])
    members = members_of(sparse)
    shown = np.bincount(blind.point_index, minlength=len(members)) > 0
    lost = lost_points(views, bitten, blind, members)
    assert lost[members & foot & shown].mean() > 0.5
    assert not lost[sparse.points[:, 2] > 0.013].any()
    assert not lost_points(views, masks, blind, members).any()


def test_the_sliver_between_an_object_and_the_border_of_a_photo_stays_open():
    mask = np.zeros((100, 120), bool)
    mask[4:80, 20:100] = True
    gap = mask.copy()
    gap[4:10, 40:70] = False
    column = np.arange(42.5, 70, 4)
    pixels = np.c_[column, np.full(len(column), 5.5)]
    whole = reached(gap, pixels)
    assert whole[4:80].sum() > 0.99 * mask.sum()
    assert not whole[:3].any()


def test_points_beside_the_object_are_not_lost(scene):
    """A wrong match stands off the wall of the pot: whoever sees it sees the pot behind it."""
    views, masks, sparse = scene
    members = members_of(sparse)
    moved = sparse.points.copy()
    off = np.flatnonzero(members)[::40]
    moved[off, :2] *= 1.15
    assert lost_points(views, masks, replace(sparse, points=moved), members)[off].mean() < 0.1


def test_masks_that_hold_the_table_are_doubted(scene):
    views, masks, _ = scene
    wide = [mask if index % 4 else np.maximum(mask, np.roll(mask, 40, axis=0)) for index, mask in enumerate(masks)]
    (reason,) = doubts(missed_by(scene, wide), [view.name for view in views])
    assert "4 of 14 masks hold points that were measured on the table" in reason


def test_few_points_say_nothing(scene):
    views, masks, sparse = scene
    members = np.zeros(len(sparse.points), bool)
    members[np.flatnonzero(members_of(sparse))[:5]] = True
    empty = [np.zeros_like(mask) for mask in masks]
    none = np.zeros(0, int)
    assert not any(item.bitten for item in missed_points(views, empty, sparse, members, none))
    assert not any(item.bitten for item in missed_points(views, empty, sparse, np.zeros(len(members), bool), none))
