"""Masks of a ball whose outline is known from a formula."""

import json

import numpy as np
import pytest
from scipy import ndimage
from solid_scene import around, block, gate, solid_scene, statue, traced
from table_scene import CENTRE, RADIUS, ball_scene

from gsbridge.cameras import Camera, View, Views
from gsbridge.errors import InputError, StageError
from gsbridge.images import read_image_u8, read_mask, write_image
from gsbridge.masks import MaskSettings, flatness, grabcut, segment_object
from gsbridge.masks.consistency import disagreements
from gsbridge.masks.grabcut import BACK, FRONT, UNSURE_BACK, UNSURE_FRONT, Crop, cut_out, tidy
from gsbridge.masks.layers import Layers, grown, median_colour, median_layer
from gsbridge.masks.prompt import find_object, focus_point
from gsbridge.masks.subtraction import amend, compare_with_table, ground_of, open_windows, stands_wide, subtract_table
from gsbridge.photogrammetry.sparse import SparsePoints, read_points

SMALL = MaskSettings(crop_px=160, hull_voxels=48, iterations=2, passes=1)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return ball_scene(tmp_path_factory.getbasetemp() / "ball")


def test_masks_follow_the_ball(scene, tmp_path):
    segment_object(scene.views, scene.points_npz, tmp_path / "images", tmp_path / "masks.json", SMALL, seed=0, threads=2)
    scores = []
    for view, true in zip(scene.views, scene.inside, strict=True):
        mask = read_mask(tmp_path / "images" / view.name) > 0.5
        scores.append((mask & true).sum() / (mask | true).sum())
    assert np.mean(scores) > 0.95
    assert min(scores) > 0.9
    record = json.loads((tmp_path / "masks.json").read_text())
    assert record["status"] == "pass"
    assert record["backend"] == "grabcut"
    assert record["area"]["mean"] == pytest.approx(np.mean([true.mean() for true in scene.inside]), rel=0.05)
    assert set(record["views"]) == {view.name for view in scene.views}


def test_seed_repeats_and_threads_do_not_matter(scene, tmp_path):
    for name, threads in (("one", 1), ("two", 2)):
        segment_object(
            scene.views, scene.points_npz, tmp_path / name, tmp_path / f"{name}.json", SMALL, seed=3, threads=threads
        )
    for view in scene.views:
        assert np.array_equal(read_mask(tmp_path / "one" / view.name), read_mask(tmp_path / "two" / view.name))


def test_prompt_lies_on_the_ball(scene):
    prompt = find_object(scene.views, read_points(scene.points_npz), 0.008, 8)
    assert np.abs(np.linalg.norm(prompt.points - CENTRE, axis=1) - RADIUS).max() < 0.002
    assert (prompt.low[:2] < CENTRE[:2] - RADIUS).all()
    assert (prompt.high > CENTRE + RADIUS).all()
    assert prompt.low[2] == 0
    assert np.linalg.norm(focus_point(scene.views) - CENTRE) < 1e-3


def test_larger_things_beside_the_focus_are_left_alone(scene):
    sparse = read_points(scene.points_npz)
    lamp = np.random.default_rng(0).normal([0.35, 0.1, 0.1], 0.02, (3000, 3))
    crowded = SparsePoints(np.concatenate([sparse.points, lamp]), sparse.view_index, sparse.point_index)
    assert np.abs(find_object(scene.views, crowded, 0.008, 8).points).max() < 0.1


def test_scale_does_not_matter(scene):
    """A scene without known scale, here a hundred times larger, gives the same prompt."""
    sparse = read_points(scene.points_npz)
    large = []
    for view in scene.views:
        pose = view.cam_from_table.copy()
        pose[:3, 3] *= 100
        large.append(View(view.name, view.camera, pose))
    near = find_object(scene.views, sparse, 0.008, 8)
    far = find_object(large, SparsePoints(100 * sparse.points, sparse.view_index, sparse.point_index), 0.008, 8)
    assert len(near.points) == len(far.points)
    np.testing.assert_allclose(far.high, 100 * near.high, rtol=1e-6)


def _rewrite(scene, path, keep):
    with np.load(scene.points_npz) as content:
        index = np.flatnonzero(keep(content["points"]))
        number = np.full(len(content["points"]), -1)
        number[index] = np.arange(len(index))
        held = number[content["point_index"]] >= 0
        np.savez(
            path,
            points=content["points"][index],
            view_index=content["view_index"][held],
            point_index=number[content["point_index"][held]],
        )


def _five_points_of_the_ball(scene, path):
    counter = np.zeros(1)

    def keep(points):
        above = points[:, 2] > 0.004
        counter[0] = above.sum()
        return ~above | (np.cumsum(above) <= 5)

    _rewrite(scene, path, keep)


def test_too_few_points_on_a_plain_table_stop_with_advice(scene, tmp_path):
    """Where the table has no pattern either, nothing tells the object from it."""
    _five_points_of_the_ball(scene, tmp_path / "points.npz")
    for view in scene.views:
        write_image(tmp_path / "grey" / view.name, np.full((view.camera.height, view.camera.width, 3), 0.5))
    views = Views(tmp_path / "grey", scene.views.views)
    with pytest.raises(StageError, match=r"points (stand above the table|lie on the object), 8 are needed.*with a pattern"):
        segment_object(views, tmp_path / "points.npz", tmp_path / "images", tmp_path / "masks.json", SMALL)
    assert not (tmp_path / "images").exists()
    assert not (tmp_path / "masks.json").exists()


@pytest.mark.parametrize("known", ["no point", "a corner"])
def test_a_plain_thing_is_found_by_the_table_that_it_hides(tmp_path, known):
    """A block without any mark, of which nothing is measured, or a handful of points at one corner."""
    camera = Camera(256, 192, 220.0, 220.0, 128.0, 96.0)
    views = around(camera, 20, (25.0, 45.0), np.array([0.0, 0.0, 0.02]))

    def plain(p):
        return (p[:, :2].sum(1) < 0.035) if known == "a corner" else np.ones(len(p), bool)

    scene = solid_scene(tmp_path, block, views, plain=plain, points=1)
    segment_object(scene.views, scene.points_npz, tmp_path / "found", tmp_path / "masks.json", SMALL, seed=0)
    scores = []
    for view, true in zip(scene.views, scene.inside, strict=True):
        mask = read_mask(tmp_path / "found" / view.name) > 0.5
        scores.append((mask & true).sum() / (mask | true).sum())
    print(min(scores), np.mean(scores))
    assert np.mean(scores) > 0.95
    assert min(scores) > 0.9
    record = json.loads((tmp_path / "masks.json").read_text())
    assert (record["status"], record["prompt"]) == ("pass", "what stands out from the table")


@pytest.mark.parametrize("lost", [1, 2])
def test_empty_masks_are_an_error(scene, tmp_path, monkeypatch, lost):
    """All masks empty: nothing in common. Every second one empty: too many, whatever the others say."""
    cut = grabcut.cut_out

    def blind(image, labels, iterations, seed):
        return cut(image, labels, iterations, seed) & (seed % lost != 0)

    monkeypatch.setattr(grabcut, "cut_out", blind)
    with pytest.raises(StageError, match="share no common volume" if lost == 1 else "empty in 7 of 14 photos.*sam2"):
        segment_object(scene.views, scene.points_npz, tmp_path / "images", tmp_path / "masks.json", SMALL)
    assert not (tmp_path / "images").exists()
    assert not (tmp_path / "masks.json").exists()


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04broken"])
def test_damaged_points_are_named(scene, tmp_path, content):
    (tmp_path / "points.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"points\.npz.*damaged"):
        segment_object(scene.views, tmp_path / "points.npz", tmp_path / "images", tmp_path / "masks.json", SMALL)


def test_missing_points_and_unknown_backend(scene, tmp_path):
    with pytest.raises(InputError, match="do not exist"):
        segment_object(scene.views, tmp_path / "none.npz", tmp_path / "images", tmp_path / "masks.json", SMALL)
    with pytest.raises(InputError, match="grabcut, sam2"):
        segment_object(scene.views, scene.points_npz, tmp_path / "i", tmp_path / "m.json", MaskSettings(backend="magic"))


def test_two_photos_are_too_few(scene, tmp_path):
    views = Views(scene.views.images, scene.views.views[:2])
    with pytest.raises(StageError, match="3 are needed"):
        segment_object(views, scene.points_npz, tmp_path / "images", tmp_path / "masks.json", SMALL)


def test_crop_keeps_pixel_coordinates():
    crop = Crop.around(np.array([[100.0, 50.0], [300.0, 150.0]]), (640, 480), 120)
    assert max(crop.size) == 120
    assert crop.left == 50
    assert crop.top == 0
    np.testing.assert_allclose(
        crop.pixels(np.array([[crop.left, crop.top], [crop.left + crop.width, crop.top]]))[:, 0], [0, 120]
    )
    image = np.zeros((480, 640), np.float32)
    image[80:120, 150:250] = 1
    back = crop.paste(crop.cut(image), (640, 480))
    assert abs(back.sum() / image.sum() - 1) < 0.05
    assert Crop.around(np.array([[-50.0, -50.0], [-10.0, -10.0]]), (640, 480), 120) is None


def test_grabcut_without_a_front_or_back_does_not_fail():
    image = np.zeros((20, 20, 3), np.uint8)
    assert not cut_out(image, np.full((20, 20), BACK, np.uint8), 1, 0).any()
    assert cut_out(image, np.full((20, 20), FRONT, np.uint8), 1, 0).all()
    assert not cut_out(image, np.full((20, 20), UNSURE_BACK, np.uint8), 1, 0).any()
    assert not cut_out(image, np.full((20, 20), UNSURE_FRONT, np.uint8), 1, 0).any()


def test_an_object_that_nearly_touches_the_edge_does_not_claim_the_sliver_between():
    rows, columns = np.mgrid[0:90, 0:120]
    solid = ((columns - 60) / 32) ** 2 + ((rows - 33) / 30) ** 2 < 1
    solid |= (np.abs(columns - 60) < 26) & (rows > 33) & (rows < 80)
    image = np.full((90, 120, 3), (150, 70, 45), np.uint8)
    image[40:] = (230, 230, 230)
    image[solid] = (120, 80, 50)
    image = np.clip(image + np.random.default_rng(0).normal(0, 8, image.shape), 0, 255).astype(np.uint8)

    def labels_of(solid):
        # A loose hull reaches beyond the edge, so that nothing between is surely back.
        labels = np.full(solid.shape, BACK, np.uint8)
        for radius, value in ((14, UNSURE_BACK), (6, UNSURE_FRONT)):
            labels[grown(solid, radius)] = value
        labels[~grown(~solid, 8)] = FRONT
        return labels

    mask = cut_out(image, labels_of(solid), 3, 1)
    assert mask[:2].sum() == 0
    assert (mask ^ solid).sum() < 0.01 * solid.sum()
    # What the edge cuts stays whole.
    mask = cut_out(image[20:], labels_of(solid[20:]), 3, 1)
    assert (mask ^ solid[20:]).sum() < 0.01 * solid.sum()


def test_tidy_keeps_the_wanted_part_and_large_holes():
    mask = np.zeros((60, 60), bool)
    mask[5:40, 5:40] = True
    mask[15:25, 15:25] = False
    mask[30, 30] = False
    mask[50:55, 50:55] = True
    out = tidy(mask)
    assert not out[52, 52]
    assert out[30, 30]
    assert not out[20, 20]
    assert tidy(mask, np.array([[52.5, 52.5]]))[52, 52]


def test_table_homography_joins_pixels_of_one_table_point(scene):
    first, second = scene.views[0], scene.views[3]
    points = np.array([[0.05, 0.02, 0.0], [-0.06, 0.04, 0.0], [0.01, -0.07, 0.0]])

    def pixels(view):
        return view.camera.project(points @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3])

    onto = flatness.table_homography(first.camera, first.cam_from_table, second.camera, second.cam_from_table)
    # The homography speaks of integer-centred pixels, as OpenCV's warps do.
    moved = np.c_[pixels(first) - 0.5, np.ones(3)] @ onto.T
    np.testing.assert_allclose(moved[:, :2] / moved[:, 2:] + 0.5, pixels(second), atol=1e-6)


def test_parallax_tells_the_table_from_the_ball(scene):
    greys = [flatness.fine_detail(read_image_u8(scene.views.path(view))) for view in scene.views]
    views = scene.views
    others = flatness.choose_others(np.stack([view.centre for view in views]), CENTRE)
    found, wrong = [], []
    for index, true in enumerate(scene.inside):
        flat = flatness.table_pixels(
            index, greys, [view.camera for view in views], [view.cam_from_table for view in views], others[index]
        )
        found.append((flat & ~true).sum() / (~true).sum())
        wrong.append((flat & true).sum() / true.sum())
    assert np.mean(found) > 0.1
    assert max(wrong) < 0.01


@pytest.fixture(scope="module")
def cut_short(scene):
    """Masks that miss the ball's side beyond 0.8 of its radius, as colour models miss a tip of the table's colour."""
    masks = []
    for view, true in zip(scene.views, scene.inside, strict=True):
        y, x = np.mgrid[: true.shape[0], : true.shape[1]] + 0.5
        rays = (
            np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(view.camera.intrinsics).T @ view.cam_from_table[:3, :3]
        )
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        along = rays @ (CENTRE - view.centre)
        root = along**2 - np.sum((CENTRE - view.centre) ** 2) + RADIUS**2
        hit = view.centre + (along - np.sqrt(np.maximum(root, 0.0)))[..., None] * rays
        masks.append(true & (hit[..., 0] < CENTRE[0] + 0.8 * RADIUS))
    return masks


@pytest.mark.parametrize("exposure", [1.0, 0.8])
def test_what_hides_the_bare_table_is_strange(scene, cut_short, exposure):
    views = scene.views
    photos = [read_image_u8(views.path(view)) for view in views]
    # A camera that changes its exposure must not make the whole table strange.
    photos = [(photo * (exposure if i % 2 else 1.0)).astype(np.uint8) for i, photo in enumerate(photos)]
    cameras, poses = [view.camera for view in views], [view.cam_from_table for view in views]
    gained, missing, wrong = 0, 0, []
    for index, (true, short) in enumerate(zip(scene.inside, cut_short, strict=True)):
        evidence = compare_with_table(index, photos, cut_short, cameras, poses)
        assert not (evidence.strange & evidence.plain).any()
        after = amend(short, evidence)
        gained += (after & true & ~short).sum()
        missing += (true & ~short).sum()
        wrong.append((after & ~true).sum() / true.sum())
        assert not amend(short, evidence, allowed=short)[~short].any()
    assert gained > 0.4 * missing
    assert np.mean(wrong) < 0.02


def test_subtraction_completes_masks(scene, cut_short):
    prompt = find_object(scene.views, read_points(scene.points_npz), 0.008, 8)
    masks = [mask.astype(np.float32) for mask in cut_short]

    def overlaps(masks):
        return [((m > 0.5) & t).sum() / ((m > 0.5) | t).sum() for m, t in zip(masks, scene.inside, strict=True)]

    assert np.mean(overlaps(masks)) < 0.9
    assert np.mean(overlaps(subtract_table(scene.views, masks, prompt, SMALL, 2))) > 0.93


def test_the_ground_under_an_object_shows_its_foot(tmp_path):
    """Masks that miss the side of a plinth, whatever its colour: no photo shows the table where it stands."""
    camera = Camera(256, 192, 220.0, 220.0, 128.0, 96.0)
    views = around(camera, 24, (25.0, 40.0), np.array([0.0, 0.0, 0.03]))
    scene = solid_scene(tmp_path, statue, views)
    masks = []
    for view, inside in zip(scene.views, scene.inside, strict=True):
        masks.append(inside & (traced(view, statue)[0][..., 2] > 0.0155))
    photos = [read_image_u8(scene.views.path(view)) for view in scene.views]
    cameras, poses = [view.camera for view in scene.views], [view.cam_from_table for view in scene.views]
    ground = ground_of(np.array([[x, y, z] for x in (-0.039, 0.039) for y in (-0.039, 0.039) for z in (0.015, 0.1)]))
    found = missing = wrong = more = 0
    for index in range(0, len(masks), 4):
        mask, true = masks[index], scene.inside[index]
        foot = compare_with_table(index, photos, masks, cameras, poses, ground=ground).foot
        assert not compare_with_table(index, photos, masks, cameras, poses).foot.any()
        found, missing = found + (foot & true).sum(), missing + (true & ~mask).sum()
        wrong += (foot & ~true).sum()
        more += compare_with_table(index, photos, scene.inside, cameras, poses, ground=ground).foot.sum()
    print(found, missing, wrong, more)
    assert found > 0.5 * missing
    assert wrong < 0.02 * missing
    assert more < 0.05 * missing


def test_only_a_foot_wider_than_its_body_is_told_by_the_ground():
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(400, 3))
    ball = 0.03 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + [0.0, 0.0, 0.03]
    plinth = np.c_[rng.uniform(-0.04, 0.04, (200, 2)), rng.uniform(0.006, 0.02, 200)]
    neck = np.c_[rng.uniform(-0.012, 0.012, (200, 2)), rng.uniform(0.02, 0.1, 200)]
    box = np.c_[rng.uniform(-0.03, 0.03, (400, 2)), rng.uniform(0.006, 0.08, 400)]
    assert stands_wide(np.concatenate([plinth, neck]))
    assert not stands_wide(ball[ball[:, 2] > 0.006])
    assert not stands_wide(box)
    assert not stands_wide(plinth[:10])


def test_bumps_of_the_table_do_not_join_the_object(scene):
    """Where the model of the table is warped, its points reach over the threshold round the object."""
    sparse = read_points(scene.points_npz)
    rng = np.random.default_rng(0)
    angle, reach = rng.uniform(0, 2 * np.pi, 400), rng.uniform(0.045, 0.14, 400)
    bumps = np.c_[reach * np.cos(angle), reach * np.sin(angle), rng.uniform(0.003, 0.009, 400)]
    warped = SparsePoints(np.concatenate([sparse.points, bumps]), sparse.view_index, sparse.point_index)
    chosen = find_object(scene.views, warped, 0.008, 8).points
    assert np.hypot(chosen[:, 0], chosen[:, 1]).max() < RADIUS + 0.01


@pytest.mark.parametrize(("width", "height"), [(539, 561), (361, 377), (401, 283), (90, 77)])
def test_the_camera_of_a_part_has_exactly_its_pixels(width, height):
    """Rounding one factor in both directions once gave 361 rows for 360."""
    pixels = np.array([[20.0, 30.0], [20.0 + width / 1.5, 30.0 + height / 1.5]])
    crop = Crop.around(pixels, (1280, 960), 360)
    view = View("a.png", Camera(1280, 960, 900.0, 900.0, 640.0, 480.0), np.eye(4), "train")
    camera = crop.camera(view.camera)
    assert crop.cut(np.zeros((960, 1280), np.uint8)).shape == (camera.height, camera.width)
    point = np.array([[-0.5, -0.4, 1.0]])
    np.testing.assert_allclose(camera.project(point), crop.pixels(view.camera.project(point)), atol=1e-9)


def test_windows_through_which_the_table_is_seen_are_opened(tmp_path):
    """Masks that are filled lose the window, and nothing else: all other pixels of the block stay."""
    camera = Camera(256, 192, 220.0, 220.0, 128.0, 96.0)
    views = around(camera, 24, (15.0, 25.0), np.array([0.0, 0.0, 0.03]))
    scene = solid_scene(tmp_path, gate, views)
    filled = [ndimage.binary_fill_holes(inside) for inside in scene.inside]
    opened = open_windows(scene.views, [mask.astype(np.float32) for mask in filled], MaskSettings(), 1)
    holes = [full & ~true for full, true in zip(filled, scene.inside, strict=True)]
    seen = sum(hole.sum() for hole in holes)
    assert seen > 1000
    assert sum(((mask < 0.5) & hole).sum() for mask, hole in zip(opened, holes, strict=True)) > 0.7 * seen
    lost = sum(((mask < 0.5) & true).sum() for mask, true in zip(opened, scene.inside, strict=True))
    assert lost < 0.02 * sum(true.sum() for true in scene.inside)


def test_medians_of_levels_are_those_of_numpy():
    """Even and odd counts, pixels that few layers show, gains that differ: the same float32 to the bit."""
    rng = np.random.default_rng(0)
    shape, count = (40, 30), 7
    photo = rng.integers(0, 256, (*shape, 3), dtype=np.uint8)
    for where in (rng.random(shape) < 0.3, photo[..., 0] > 250, np.ones(shape, bool)):
        np.testing.assert_array_equal(
            median_colour(photo, where), np.median(photo[where].astype(np.float32) / 255, axis=0), strict=True
        )
    gains = rng.uniform(0.7, 1.4, (count, 1, 3)).astype(np.float32)
    shown, bare = rng.integers(0, 256, (count, *shape, 3), dtype=np.uint8), rng.random((count, *shape)) < 0.6
    layers = Layers(shown, bare, (np.arange(256, dtype=np.float32) / 255)[:, None] * gains)
    values = np.where(bare[..., None], shown.astype(np.float32) / 255 * gains[:, None], np.nan)
    where, fallback = rng.random(shape) < 0.8, np.full((*shape, 3), 2.0, np.float32)
    table, known = median_layer(layers, where, fallback, 4)
    np.testing.assert_array_equal(known, where & (bare.sum(0) >= 4))
    np.testing.assert_array_equal(table[known], np.nanmedian(values[:, known], axis=0), strict=True)
    assert (table[~known] == 2.0).all()


def test_an_object_without_windows_keeps_its_masks(scene):
    masks = [inside.astype(np.float32) for inside in scene.inside]
    for before, after in zip(masks, open_windows(scene.views, masks, SMALL, 1), strict=True):
        np.testing.assert_array_equal(before, after)


def test_the_worst_mask_is_named():
    names = [f"{index:04d}.png" for index in range(10)]
    assert disagreements([0.97] * 9 + [0.6], names, 0.85) == []
    (some,) = disagreements([0.97] * 7 + [0.8, 0.5, 0.7], names, 0.85)
    assert "3 of 10 masks" in some
    assert "0008.png, 0.50" in some
    (all_of_them,) = disagreements([0.8] * 10, names, 0.85)
    assert "agree to 0.80 only" in all_of_them
