"""Open and hollow things: what measured depth and the outlines say, against solids known from formulas."""

import functools
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from solid_scene import POT_FLOOR, POT_HEIGHT, POT_RIM, around, block, filled_pot, pot, solid_scene, statue, traced

from gsbridge.cameras import Camera, Views
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.images import read_image, write_image
from gsbridge.mesh import objects
from gsbridge.mesh.beside import beside_doubts, points_beside
from gsbridge.mesh.depth import DepthCloud, seen_through
from gsbridge.mesh.doubts import doubts, frame_doubts, outline_doubts, outline_overlaps
from gsbridge.mesh.fuse import fuse, measured_wall
from gsbridge.mesh.hollow import carved, guessed_inside, guessed_share, lowered, needed_height
from gsbridge.mesh.hull import build_hull, fewest_views, read_masks
from gsbridge.mesh.repair import closed_surface
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.carving import largest_component, mesh_of_field
from gsbridge.photogrammetry.cavity import cavity_depth

CAMERA = Camera(200, 150, 235.0, 235.0, 100.0, 75.0)
MIDDLE = np.array([0.0, 0.0, 0.025])


@functools.cache
def look(solid, lifts_deg, count=18):
    """Views of a solid, its outlines, their hull, and the true depth as if all of it had been confirmed."""
    views = around(CAMERA, count, lifts_deg, MIDDLE)
    seen = [traced(view, solid) for view in views]
    masks = [on.astype(np.float32) for _, _, on in seen]
    depths = tuple(np.where(on, depth, 0.0).astype(np.float32) for _, depth, on in seen)
    points = np.concatenate([at[on] for at, _, on in seen])[::7]
    cloud = DepthCloud(points, np.zeros_like(points), tuple(depth > 0 for depth in depths), tuple(views), 1, depths)
    return views, masks, build_hull(views, masks, vote=0.95, voxels=64, width=200, threads=1), cloud


def centres_of(views):
    return np.stack([view.centre for view in views])


@pytest.fixture(scope="module")
def one_height():
    return look(pot, (38.0,))


def blind(cloud):
    """The same views where nothing was measured."""
    return DepthCloud(cloud.points[:0], cloud.points[:0], (), cloud.views, 1, tuple(0 * depth for depth in cloud.depths))


def test_outlines_from_one_height_leave_a_cone_that_goes(one_height):
    views, masks, hull, cloud = one_height
    assert hull.mesh.vertices[:, 2].max() > POT_HEIGHT + 0.015
    assert needed_height(hull, views, masks) == pytest.approx(POT_HEIGHT, abs=0.0015)
    low = lowered(hull, views, masks, lambda: cloud)
    assert low.mesh.vertices[:, 2].max() == pytest.approx(POT_HEIGHT, abs=0.002)
    assert low.mesh.is_watertight()


def test_depth_empties_the_pot_as_far_as_it_is_seen(one_height):
    views, masks, hull, cloud = one_height
    left, share = carved(lowered(hull, views, masks, lambda: cloud), cloud, threads=1)
    again, _ = carved(lowered(hull, views, masks, lambda: cloud), cloud, threads=2)
    np.testing.assert_array_equal(left.field, again.field)
    assert share > 0.2
    assert left.mesh.is_watertight()
    x, y, z = np.meshgrid(*(left.grid.axis(k) for k in range(3)), indexing="ij")
    truth = pot(np.stack([x, y, z], -1).reshape(-1, 3)).reshape(x.shape)
    # No wall is drilled through: what the pot is made of stays, give or take a voxel.
    assert (left.field[truth < -1.5 * left.grid.spacing] > 0).mean() > 0.99
    # From 38 degrees a line of sight over the near rim meets the far wall about half way down.
    inner = (np.hypot(x, y) < 0.02) & (z > 0.038) & (z < POT_HEIGHT)
    assert (left.field[inner] > 0).mean() < 0.02


def test_a_program_that_knows_points_alone_does_not_close_an_opening(one_height, monkeypatch):
    """Its points are the surface; that the pot is empty is what the sweep's depth maps tell."""
    views, masks, hull, cloud = one_height
    rng = np.random.default_rng(0)
    normals = rng.normal(size=cloud.points.shape)
    points = cloud.points, normals / np.linalg.norm(normals, axis=1, keepdims=True)
    monkeypatch.setattr(objects, "choose_backend", lambda name: "openmvs")
    monkeypatch.setattr(objects, "external_points", lambda *_: points)
    monkeypatch.setattr(objects, "depth_cloud", lambda *_: cloud)
    monkeypatch.setattr(objects, "fuse", lambda hull, cloud, *_, **more: (hull.grid, hull.field, {"points": cloud.points}))
    _, field, figures, measured = objects._solid(views, masks, hull, cloud.points, MeshSettings(), False, 0, 1)
    left, share = carved(lowered(hull, views, masks, lambda: cloud), cloud, threads=1)
    np.testing.assert_array_equal(field, left.field)
    assert figures["cavity_share"] == share > 0.2
    assert figures["lowered_share"] > 0.1
    np.testing.assert_array_equal(measured, points[0][points[0][:, 2] > 0.5 * hull.grid.spacing])


def speckled(cloud, keep, share):
    """The same depth where `keep` of its points says so, elsewhere in speckles that cover a share of it."""
    rng, depths = np.random.default_rng(3), []
    for view, depth in zip(cloud.views, cloud.depths, strict=True):
        pose = view.cam_from_table
        at = (view.camera.pixel_rays() * depth[..., None] - pose[:3, 3]) @ pose[:3, :3]
        depths.append(np.where(keep(at) | (rng.random(depth.shape) < share), depth, 0.0).astype(np.float32))
    return replace(cloud, depths=tuple(depths))


def test_speckles_of_depth_empty_a_pot_as_well_as_all_of_it():
    """Compressed photos measure the dark inside of a real pot in speckles, and heaps of up to 19 mm stayed before its wall."""
    views, masks, hull, cloud = look(pot, (38.0, 65.0))
    low = lowered(hull, views, masks, lambda: cloud)
    few = speckled(cloud, lambda at: (np.hypot(at[..., 0], at[..., 1]) > POT_RIM - 0.004) | (at[..., 2] > 0.035), 0.25)
    x, y, z = np.meshgrid(*(low.grid.axis(k) for k in range(3)), indexing="ij")
    truth = pot(np.stack([x, y, z], -1).reshape(-1, 3)).reshape(x.shape)
    space = (truth > 2.5 * low.grid.spacing) & (np.hypot(x, y) < POT_RIM) & (z > 0) & (z < POT_HEIGHT)
    filled = []
    for measured in (cloud, few):
        left, share = carved(low, measured, threads=1)
        assert share > 0.3
        assert (left.field[truth < -1.5 * left.grid.spacing] > 0).mean() > 0.99
        filled.append((left.field[space] > 0).mean())
    assert max(filled) < 0.03


def test_plain_rods_before_a_measured_wall_stay():
    """No depth shows the rods, and the depth around their pixels is the wall's."""
    across = np.array([-0.02, -0.007, 0.007, 0.02])

    def rods(p):
        rho = np.hypot(p[:, None, 0] - 0.026, p[:, None, 1] - across).min(1)
        return np.maximum(rho - 0.003, np.abs(p[:, 2] - 0.025) - 0.025)

    def solid(p):
        foot = (np.abs(p - (0.009, 0.0, 0.004)) - (0.021, 0.03, 0.004)).max(1)
        return np.minimum(np.minimum((np.abs(p - (0.0, 0.0, 0.025)) - (0.012, 0.03, 0.025)).max(1), foot), rods(p))

    _, _, hull, cloud = look(solid, (30.0,))
    bare = speckled(cloud, lambda at: rods(at.reshape(-1, 3)).reshape(at.shape[:2]) > 5e-4, 0.0)
    axis = np.stack(np.meshgrid([0.026], across, np.linspace(0.012, 0.044, 20)), axis=-1).reshape(-1, 3)
    index = tuple(np.round((axis - hull.grid.origin) / hull.grid.spacing).astype(int).T)
    assert (hull.field[index] > 0).all()
    left, _ = carved(hull, bare, threads=1)
    assert (left.field[index] > 0).all()


def cup(p):
    """Signed distance of a deep cup, 85 mm tall, 60 mm wide inside, 79 mm deep, m. [N, 3] -> [N]."""
    rho, z = np.hypot(p[:, 0], p[:, 1]), p[:, 2]
    outside = np.maximum(np.maximum(rho - 0.034, z - 0.085), -z)
    return np.maximum(outside, -np.maximum(rho - 0.030, 0.006 - z))


def shares(unseen, cavity=0.0, guessed=0.0, inside=(0.0, 0.0)):
    names = ("open_share", "cavity_share", "guessed_share", "guessed_inside_share", "guessed_inside_reach")
    return dict(zip(names, (unseen, cavity, guessed, *inside), strict=True))


def test_a_bottom_that_nobody_saw_is_a_guess():
    """From 45 degrees the far wall is seen 60 mm deep, and the middle of the opening 30 mm deep."""
    views, masks, hull, cloud = look(cup, (30.0, 45.0))
    left, share = carved(lowered(hull, views, masks, lambda: cloud), cloud, threads=1)
    guessed = guessed_share(left.mesh, cloud.points)
    assert share > 0.2
    assert guessed > 0.3
    (floor,) = doubts(left.mesh, cloud.points[:5], shares(0.1, share, guessed))
    assert "unseen and a guess" in floor
    assert doubts(left.mesh, cloud.points[:5], shares(0.1, 0.0, guessed)) == []
    assert guessed_share(left.mesh, np.zeros((0, 3))) == 1.0


def test_a_bottom_that_was_seen_is_no_guess():
    views, masks, hull, cloud = look(pot, (38.0, 65.0))
    left, _ = carved(lowered(hull, views, masks, lambda: cloud), cloud, threads=1)
    assert guessed_share(left.mesh, cloud.points) < 0.1


def test_an_inner_wall_that_no_depth_shows_is_a_guess():
    """No outline shows it, and it hardly faces upward: compressed photos measured the bottom and the rim alone."""
    views, masks, hull, cloud = look(pot, (38.0, 65.0))
    left, share = carved(lowered(hull, views, masks, lambda: cloud), cloud, threads=1)
    assert max(guessed_inside(left.mesh, cloud.points, hull.mesh, centres_of(views))) < 0.05
    x, y, z = cloud.points.T
    wall = (np.hypot(x, y) < 0.5 * (POT_RIM + 0.025)) & (z > 1.5 * POT_FLOOR) & (z < 0.8 * POT_HEIGHT)
    inside = guessed_inside(left.mesh, cloud.points[~wall], hull.mesh, centres_of(views))
    guessed = guessed_share(left.mesh, cloud.points[~wall])
    assert guessed < 0.1
    (reason,) = doubts(left.mesh, cloud.points[:5], shares(0.1, share, guessed, inside))
    assert "that no outline shows" in reason
    # What depth did not hollow out is as the outlines say.
    assert doubts(left.mesh, cloud.points[:5], shares(0.1, 0.0, guessed, inside)) == []


def test_a_small_place_far_from_all_points_is_a_guess_too():
    """A heap on the inner wall takes little of it: how far it is from what was measured tells what its share does not."""
    views, masks, hull, cloud = look(pot, (38.0, 65.0))
    left, share = carved(lowered(hull, views, masks, lambda: cloud), cloud, threads=1)
    size = np.ptp(left.mesh.vertices, axis=0).max()
    wall = np.array([0.5 * (POT_RIM + 0.025), 0.0, 0.6 * POT_HEIGHT])
    for hole, said in ((0.05, False), (0.2, True)):
        kept = cloud.points[np.linalg.norm(cloud.points - wall, axis=1) > hole * size]
        part, reach = guessed_inside(left.mesh, kept, hull.mesh, centres_of(views))
        assert part < 0.15
        reasons = doubts(left.mesh, kept[:5], shares(0.1, share, 0.0, (part, reach)))
        assert [bool(reasons), "a heap or a pit" in " ".join(reasons)] == [said, said]
        assert reach == pytest.approx(max(hole, 0.03), abs=0.07)


def test_a_convex_thing_has_no_inside():
    thing = box([-0.02, -0.02, 0.0], [0.02, 0.02, 0.06])
    assert guessed_inside(thing, np.zeros((0, 3)), thing, np.array([[0.3, 0.0, 0.2]])) == (0.0, 0.0)


@pytest.mark.parametrize(("around_deg", "seen_from"), [(360, "round"), (60, "one side")])
def test_what_faces_away_from_every_camera_is_no_opening(around_deg, seen_from):
    """Outlines leave a skirt below the belly of an apple, and a cone behind one that is filmed from one side alone."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.036)
    ball.apply_translation([0.0, 0.0, 0.036])
    hull = trimesh.creation.cylinder(radius=0.05, height=0.08)
    hull.apply_translation([0.0 if seen_from == "round" else -0.014, 0.0, 0.04])
    angles = np.radians(np.linspace(-0.5, 0.5, 12) * around_deg)
    centres = np.stack([0.1 * np.cos(angles), 0.1 * np.sin(angles), np.full(12, 0.4)], axis=1)
    normals, middles = ball.face_normals, ball.triangles_center
    visible = (np.einsum("fk,vk->fv", normals, centres) > (normals * middles).sum(1)[:, None]).any(1)
    thing, outlines = Mesh(ball.vertices, ball.faces), Mesh(hull.vertices, hull.faces)
    from_below_too = np.array([*centres, [0.0, 0.0, -0.5], [-0.5, 0.0, 0.0]])
    assert guessed_inside(thing, middles[visible], outlines, from_below_too)[0] > 0.15
    assert guessed_inside(thing, middles[visible], outlines, centres)[0] == 0.0


def outward(solid, points):
    """Normals of a signed distance, by differences."""
    step = 1e-4 * np.eye(3)
    slope = np.stack([solid(points + shift) - solid(points - shift) for shift in step], axis=-1)
    return slope / np.linalg.norm(slope, axis=1, keepdims=True)


def test_a_hole_that_bitten_masks_cut_into_a_measured_floor_is_closed():
    """The hull lacks a part of the pot's floor, as where a few masks lose its dark foot."""
    views, masks, hull, cloud = look(pot, (38.0, 65.0))
    left, _ = carved(lowered(hull, views, masks, lambda: cloud), cloud, threads=1)
    # The floor as densely as a real cloud shows it.
    floor = np.stack(np.meshgrid(*2 * [np.arange(-0.018, 0.018, 4e-4)]), axis=-1).reshape(-1, 2)
    floor = floor[np.hypot(*floor.T) < 0.018]
    points = np.concatenate([cloud.points, np.c_[floor, np.full(len(floor), POT_FLOOR)]])
    cloud = replace(cloud, points=points, normals=outward(pot, points))
    x, y, z = np.meshgrid(*(left.grid.axis(k) for k in range(3)), indexing="ij")
    bite = np.maximum(np.maximum(np.abs(x - 0.008) - 0.006, np.abs(y) - 0.01), z - 0.03)
    uncut = np.minimum(left.uncut, bite).astype(np.float32)
    field = np.minimum(uncut, z).astype(np.float32)
    mesh = mesh_of_field(left.grid, largest_component(field))
    bitten = replace(left, uncut=uncut, field=field, mesh=mesh)
    assert cavity_depth(mesh) == 0.0
    wall = measured_wall(left.grid, cloud, bitten)
    assert (wall[(pot(np.stack([x, y, z], -1).reshape(-1, 3)) > 0.5 * left.grid.spacing).reshape(x.shape)] <= 0).all()
    grid, solid, _ = fuse(bitten, cloud, views, MeshSettings(), narrow=False, seed=1)
    closed = closed_surface(grid, solid, 8000)
    assert cavity_depth(closed) == pytest.approx(POT_HEIGHT - POT_FLOOR, abs=0.003)
    # Nor does a lone point beside the pot that seems to face upward.
    lone = np.array([[POT_RIM + 0.004, 0.0, 0.03]])
    one = replace(
        cloud, points=np.concatenate([cloud.points, lone]), normals=np.concatenate([cloud.normals, [[0.0, 0.0, 1.0]]])
    )
    np.testing.assert_array_equal(measured_wall(left.grid, one, bitten), wall)
    # Nothing that faces upward near the table or at the top, and no side, grows a wall.
    flat = np.array([[0.0, 0.0, 0.0005], [0.0, 0.0, POT_HEIGHT], [0.02, 0.0, 0.025]])
    facing = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    assert (measured_wall(left.grid, replace(cloud, points=flat, normals=facing), left) < 0).all()


def test_chance_matches_that_photos_look_through_grow_no_wall():
    """A patch of points beside a pot that seems to face upward, as wrong matches inside a speckled one leave."""
    _, _, hull, cloud = look(pot, (25.0, 40.0))
    cloud = replace(cloud, normals=outward(pot, cloud.points))
    across = np.stack(np.meshgrid(*2 * [np.arange(-0.0016, 0.0017, 4e-4)]), axis=-1).reshape(-1, 2)
    patch = np.c_[across, np.zeros(len(across))] + (POT_RIM + 0.003, 0.0, 0.03)
    assert seen_through(patch, cloud, hull.size).sum() > 0.5 * len(patch)
    assert not seen_through(cloud.points, cloud, hull.size).any()
    more = replace(
        cloud,
        points=np.concatenate([cloud.points, patch]),
        normals=np.concatenate([cloud.normals, np.tile([0.0, 0.0, 1.0], (len(patch), 1))]),
    )
    np.testing.assert_array_equal(measured_wall(hull.grid, more, hull), measured_wall(hull.grid, cloud, hull))


def test_a_full_pot_stays_full():
    views, masks, hull, cloud = look(filled_pot, (38.0,))
    left, _ = carved(lowered(hull, views, masks, lambda: cloud), cloud, threads=1)
    x, y, z = np.meshgrid(*(left.grid.axis(k) for k in range(3)), indexing="ij")
    truth = filled_pot(np.stack([x, y, z], -1).reshape(-1, 3)).reshape(x.shape)
    assert (left.field[truth < -1.5 * left.grid.spacing] > 0).mean() > 0.995
    assert left.mesh.vertices[:, 2].max() == pytest.approx(POT_HEIGHT, abs=0.002)


def test_without_depth_nothing_is_carved_and_a_narrow_top_stays(one_height):
    views, masks, hull, cloud = one_height
    assert carved(hull, blind(cloud), threads=1) == (hull, 0.0)
    views, masks, hull, cloud = look(statue, (25.0, 45.0))
    # Its head is measured by no depth and needed by every outline.
    assert lowered(hull, views, masks, lambda: blind(cloud)) is hull


def box(low, high):
    mesh = trimesh.creation.box(bounds=[low, high])
    return Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def surface(low, high, count=400):
    points, _ = trimesh.sample.sample_surface(trimesh.creation.box(bounds=[low, high]), count, seed=0)
    return np.asarray(points)


def test_doubts_name_what_disagrees():
    low, high = [-0.02, -0.02, 0.0], [0.02, 0.02, 0.06]
    fine = surface(low, high)
    assert doubts(box(low, high), fine, shares(0.1)) == []
    assert doubts(box(low, high), fine[:5], shares(0.1)) == []
    (tall,) = doubts(box(low, [0.02, 0.02, 0.072]), fine, shares(0.1))
    assert "72 mm tall, the measured points reach 60 mm" in tall
    plinth = surface([-0.05, -0.05, 0.0], [0.05, 0.05, 0.012])
    (missing,) = doubts(box(low, high), np.concatenate([fine, plinth]), shares(0.1))
    assert "outside the mesh" in missing
    (hollow,) = doubts(box(low, high), np.concatenate([fine, surface([-0.01, -0.01, 0.02], [0.01, 0.01, 0.05])]), shares(0.1))
    assert "deep inside the mesh" in hollow
    (unseen,) = doubts(box(low, high), fine, shares(0.8))
    assert "whether it is open there is unknown" in unseen
    # Depth that empties a part of a hull does not make a closed box open.
    (plain,) = doubts(box(low, high), fine, shares(0.1, 0.3, 0.5))
    assert "50 %" in plain
    assert "whether it is open there is unknown" in plain
    wall, bottom = trimesh.creation.annulus(0.017, 0.02, 0.06), trimesh.creation.cylinder(0.018, 0.01)
    wall.apply_translation([0, 0, 0.03])
    bottom.apply_translation([0, 0, 0.005])
    open_one = trimesh.util.concatenate([wall, bottom])
    (floor,) = doubts(Mesh(np.asarray(open_one.vertices), np.asarray(open_one.faces)), fine[:5], shares(0.8, 0.3))
    assert "bottom of its opening is unseen" in floor


def test_outlines_contradict_a_mesh_that_lacks_the_plinth():
    views = around(CAMERA, 12, (25.0, 50.0), MIDDLE)
    masks = [traced(view, statue)[2].astype(np.float32) for view in views]
    names = [view.name for view in views]
    whole = build_hull(views, masks, vote=0.95, voxels=64, width=200, threads=1).mesh
    sound = outline_overlaps(whole, views, masks)
    assert sound.min() > 0.9
    assert outline_doubts(sound, names) == []
    (body,) = outline_doubts(outline_overlaps(box([-0.012, -0.012, 0.0], [0.012, 0.012, 0.1]), views, masks), names)
    assert "a part is missing" in body
    (some,) = outline_doubts(np.where(np.arange(12) < 3, 0.8, sound), names)
    assert "in 3 of 12 photos" in some
    assert outline_doubts(np.full(2, np.nan), names[:2]) == []


def test_a_mesh_that_ends_with_the_photos_is_said_to():
    views = around(CAMERA, 12, (25.0, 50.0), MIDDLE)

    def hull_in(views, masks):
        return build_hull(views, masks, vote=1.0, voxels=48, width=200, threads=1).mesh

    masks = [traced(view, pot)[2].astype(np.float32) for view in views]
    assert frame_doubts(hull_in(views, masks), views, fewest_views(12)) == []
    # The same photos without their upper part: the hull ends where they do.
    low = [replace(view, camera=view.camera.cropped(0, 62, 200, 88)) for view in views]
    (reason,) = frame_doubts(hull_in(low, [mask[62:] for mask in masks]), low, fewest_views(12))
    assert "ends where the photos do" in reason


def test_depth_beside_the_masks_is_a_part_that_they_lost(tmp_path):
    def with_chimney(p):
        chimney = np.linalg.norm(p - np.clip(p, [0.018, -0.006, 0.0], [0.03, 0.006, 0.085]), axis=-1)
        return np.minimum(block(p), chimney)

    views = around(Camera(160, 120, 200.0, 200.0, 80.0, 60.0), 10, (35.0,), MIDDLE)
    photos = Views(tmp_path / "images", views)
    settings = MeshSettings(image_width=160, stride=1)
    mesh = box([-0.03, -0.02, 0.0], [0.03, 0.02, 0.05])
    solid_scene(tmp_path, block, views, points=1)
    masks = read_masks(photos, tmp_path / "masks")
    assert beside_doubts(mesh, points_beside(photos, masks, settings, seed=1)) == []
    solid_scene(tmp_path, with_chimney, views, points=1)
    (reason,) = beside_doubts(mesh, points_beside(photos, masks, settings, seed=1))
    assert "beside the mesh" in reason


def test_a_printed_grid_that_matches_itself_one_line_further_is_no_part(tmp_path):
    """Photos of an even orbit all see it at the same height above the table."""
    views = around(Camera(240, 180, 300.0, 300.0, 120.0, 90.0), 20, (35.0,), MIDDLE)
    solid_scene(tmp_path, block, views, points=1)
    for view in views:
        at, _, on = traced(view, block)
        waves = np.cos(2 * np.pi * at[..., :2] / 0.004).sum(-1, keepdims=True)
        picture = read_image(tmp_path / "images" / view.name)
        picture[~on] = (0.2 * picture + 0.8 * (0.5 + 0.22 * waves))[~on]
        write_image(tmp_path / "images" / view.name, picture)
    masks = read_masks(views, tmp_path / "masks")
    points = points_beside(Views(tmp_path / "images", views), masks, MeshSettings(image_width=240, stride=1), seed=1)
    assert len(points) > 1000
    assert beside_doubts(box([-0.03, -0.02, 0.0], [0.03, 0.02, 0.05]), points) == []
