"""Scores against truth and floors, checked on scenes whose errors are known by construction."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial.transform import Rotation

from gsbridge.cameras import Camera, View, camera_centre, look_at, write_views
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.geometry import Similarity
from gsbridge.images import write_image
from gsbridge.meshes import Mesh
from gsbridge.report.scores.measured_scenes import rasterizer_figures, rendering_figures, write_real2sim_figures
from gsbridge.report.scores.results_page import AREAS, changes, freshness, laboratories_markdown, write_results_page
from gsbridge.report.scores.scene import (
    camera_scores,
    chamfer,
    mask_iou,
    sample_surface,
    score_scene,
    surface_distance,
    table_scores,
    undistort_mask,
)
from gsbridge.report.scores.score import read_floors, score_figure, write_scores
from gsbridge.report.tables.rendering_rows import COLUMNS
from gsbridge.report.tables.rows import write_rows

BEHIND = {"code": {"score_scene": "1"}, "settings": {"seed": "a"}}
ROOT = Path(__file__).parents[2]
FLOORS = ROOT / "benchmarks" / "floors.yaml"
LENS = Camera(160, 120, 140.0, 141.0, 79.0, 61.0, (0.08, -0.03, 0.002, -0.001))


def _orbit(count: int) -> list[np.ndarray]:
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return [look_at(np.array([0.6 * np.cos(a), 0.6 * np.sin(a), 0.45 + 0.05 * np.sin(3 * a)]), np.zeros(3)) for a in angles]


def _moved(poses: list[np.ndarray], move: Similarity) -> list[np.ndarray]:
    return [move.move_pose(pose) for pose in poses]


def _camera_scores(estimated: list[np.ndarray], true: list[np.ndarray], area: tuple[float, float]) -> dict[str, float]:
    rotations = np.array([t[:3, :3].T @ e[:3, :3] for e, t in zip(estimated, true, strict=True)])
    centres = [np.array([camera_centre(pose) for pose in poses]) for poses in (estimated, true)]
    return camera_scores(*centres, rotations, np.array(area))


def test_camera_scores_find_the_move_that_was_made() -> None:
    true = _orbit(24)
    # True table from estimated table: 0.3 degrees about x, 2 mm up; so the estimate is the true one moved back.
    tilt = Rotation.from_euler("x", 0.3, degrees=True).as_matrix()
    true_from_estimated = Similarity(1.0, tilt, np.array([0.0, 0.0, 0.002]))
    scores = _camera_scores(_moved(true, true_from_estimated.inverse()), true, (0.0, 0.2))
    assert scores["tilt_deg"] == pytest.approx(0.3, abs=1e-6)
    assert scores["tilt_by_rotations_deg"] == pytest.approx(0.3, abs=1e-6)
    assert scores["scale_percent"] == pytest.approx(0.0, abs=1e-9)
    # Height of the table at the centre of the area, 0.2 m along y, and at its far edge, 0.35 m along y.
    assert scores["height_centre_mm"] == pytest.approx(2 + 200 * np.sin(np.radians(0.3)), abs=1e-6)
    assert scores["height_mm"] == pytest.approx(2 + 350 * np.sin(np.radians(0.3)), abs=1e-6)
    assert scores["camera_mm_max"] >= scores["camera_mm_median"] > 1.0


def test_camera_scores_keep_scale_apart_from_height() -> None:
    true = _orbit(24)
    scores = _camera_scores(_moved(true, Similarity(1.01, np.eye(3), np.zeros(3))), true, (0.0, 0.0))
    assert scores["scale_percent"] == pytest.approx(1.0, abs=1e-9)
    assert scores["tilt_deg"] == pytest.approx(0.0, abs=1e-6)
    assert scores["height_mm"] == pytest.approx(0.0, abs=1e-6)
    # Cameras lie 0.75 m from the origin: one percent of it is the camera error.
    assert scores["camera_mm_median"] == pytest.approx(7.5, abs=0.4)


def _rays(camera: Camera) -> np.ndarray:
    """Directions (x, y at z = 1) through all pixel centres, lens distortion undone by fixed-point steps."""
    flat = camera.undistorted().pixel_rays()
    rays = flat.copy()
    for _ in range(50):
        pixels = camera.project(rays)
        bent = np.dstack([(pixels[..., 0] - camera.cx) / camera.fx, (pixels[..., 1] - camera.cy) / camera.fy])
        rays[..., :2] += flat[..., :2] - bent
    return rays[..., :2]


def test_undistortion_sees_each_direction_where_the_pinhole_does() -> None:
    # Twice the resolution, so that half a pixel forgotten in one of the cameras would not cancel.
    pinhole = Camera(280, 200, 270.0, 272.0, 140.5, 99.0)

    def spot(rays: np.ndarray) -> np.ndarray:
        return np.exp(-(((rays - [0.1, -0.05]) / 0.2) ** 2).sum(-1)).astype(np.float32)

    undistorted = undistort_mask(spot(_rays(LENS)), LENS, pinhole)
    wanted = spot(_rays(pinhole))
    inner = np.s_[20:-20, 20:-20]
    # Bilinear interpolation errs by at most h^2 / 8 * f'' along each axis: 6.4e-4. A quarter of a film pixel would be 0.0077.
    assert np.abs(undistorted - wanted)[inner].max() < 7e-4
    with pytest.raises(ValueError, match="its camera"):
        undistort_mask(wanted, LENS, pinhole)


def test_iou_by_hand() -> None:
    a, b = np.zeros((4, 4)), np.zeros((4, 4))
    a[:2], b[1:3] = 1, 1
    assert mask_iou(a, b) == pytest.approx(4 / 12)
    assert mask_iou(np.zeros((2, 2)), np.zeros((2, 2))) == 1.0


def _raised(shape: trimesh.Trimesh, height: float) -> Mesh:
    return Mesh(shape.vertices + np.array([0, 0, height]), np.asarray(shape.faces))


def _ball(radius: float) -> Mesh:
    return _raised(trimesh.creation.icosphere(4, radius), 0.05)


def test_chamfer_of_concentric_balls_is_their_distance() -> None:
    found = chamfer(_ball(0.041), _ball(0.040))
    assert found["accuracy_mm"] == pytest.approx(1.0, abs=0.02)
    assert found["completeness_mm"] == pytest.approx(1.0, abs=0.02)
    assert found["chamfer_mm"] == pytest.approx(1.0, abs=0.02)


def test_chamfer_ignores_what_lies_on_the_table() -> None:
    top = _raised(trimesh.creation.box((0.06, 0.06, 0.04)), 0.02)
    skirt = _raised(trimesh.creation.box((0.3, 0.3, 0.002)), 0.001)
    joined = Mesh(np.r_[top.vertices, skirt.vertices], np.r_[top.faces, skirt.faces + len(top.vertices)])
    assert chamfer(joined, top)["chamfer_mm"] == pytest.approx(0.0, abs=1e-4)
    with pytest.raises(ValueError, match="nothing above"):
        chamfer(skirt, top)


def test_surface_samples_and_distances_agree_with_trimesh() -> None:
    mesh = _ball(0.04)
    points = sample_surface(mesh, 2000, 3)
    assert np.abs(surface_distance(points, mesh)).max() < 1e-6
    upper = (points[:, 2] > 0.05).mean()
    assert upper == pytest.approx(0.5, abs=0.04)
    away = np.random.default_rng(0).normal(0, 0.1, (20, 3))
    nearest = trimesh.proximity.closest_point_naive(mesh.trimesh(), away)[1]
    np.testing.assert_allclose(surface_distance(away, mesh), nearest, atol=1e-6)


@pytest.fixture
def scored(tmp_path: Path) -> dict:
    """A scene whose estimate is the truth, pushed 1 mm along x; masks lose one row in four."""
    true = _orbit(6)
    pinhole = LENS.undistorted()
    names = [f"{index:04d}.png" for index in range(6)]
    moved = _moved(true, Similarity(1.0, np.eye(3), np.array([1e-3, 0, 0])))
    views = [View(name, pinhole, pose) for name, pose in zip(names, moved, strict=True)]
    write_views(tmp_path / "views.json", views[:5])
    frames = [{"name": name, "cam_from_table": pose.tolist()} for name, pose in zip(names, true, strict=True)]
    flat = Camera.from_json({**LENS.to_json(), "distortion": [0, 0, 0, 0]})
    write_json(tmp_path / "truth.json", {"camera": flat.to_json(), "frames": frames, "object": "cube"})
    write_json(tmp_path / "sfm.json", {"registered": 5, "total": 6, "camera": flat.to_json()})
    for name in names:
        write_image(tmp_path / "images" / name, np.zeros((120, 160, 3), np.float32))
        mask = np.zeros((120, 160), np.uint8)
        mask[40:80, 60:100] = 255
        write_image(tmp_path / "true_masks" / name, mask)
        mask[40:50] = 0
        write_image(tmp_path / "masks" / name, mask)
    box = trimesh.creation.box((0.06, 0.06, 0.06))
    box.apply_translation([0, 0.2, 0.03])
    box.export(tmp_path / "true.ply")
    box.apply_translation([0, 0, 0.001])
    box.export(tmp_path / "visual.ply")
    box.update_faces(np.arange(len(box.faces)) > 0)
    box.export(tmp_path / "collision.ply")
    return {
        "scene": "cube",
        "kind": "object",
        "sfm_json": tmp_path / "sfm.json",
        "views_json": tmp_path / "views.json",
        "images": tmp_path / "images",
        "truth_json": tmp_path / "truth.json",
        "masks": tmp_path / "masks",
        "true_masks": tmp_path / "true_masks",
        "visual": tmp_path / "visual.ply",
        "collision": tmp_path / "collision.ply",
        "true_mesh": tmp_path / "true.ply",
    }


def test_scene_score_by_hand(scored: dict) -> None:
    score = score_scene(**scored)
    assert score["registered_percent"] == pytest.approx(500 / 6)
    assert score["camera_mm_median"] == pytest.approx(1.0, abs=1e-6)
    assert (score["mask_iou_mean"], score["mask_iou_min"], score["masks"]) == (pytest.approx(0.75), pytest.approx(0.75), 5)
    assert score["visual_watertight"]
    assert not score["collision_watertight"]
    # Sides coincide but for 1 mm at the top; the raised top is 1 mm off. Areas: four sides of 36 cm2 and a top.
    assert 0.1 < score["visual_chamfer_mm"] < 0.35
    assert score["height_mm"] == pytest.approx(0.0, abs=1e-6)
    (scored["masks"] / "0002.png").unlink()
    with pytest.raises(InputError, match="mask is missing"):
        score_scene(**scored)


def test_table_scores_by_hand(tmp_path: Path) -> None:
    def rectangle(low: tuple[float, float], high: tuple[float, float], name: str) -> Path:
        corners = np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])
        mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False).subdivide_to_size(0.02, max_iter=20)
        mesh.export(tmp_path / name)
        return tmp_path / name

    true = rectangle((-0.6, -0.5), (0.6, 0.5), "true.ply")
    scores = table_scores(rectangle((-0.5, -0.3), (0.7, 0.4), "visual.ply"), true)
    assert (scores["table_long_m"], scores["table_short_m"]) == (pytest.approx(1.2), pytest.approx(0.7))
    assert scores["table_outside_percent"] == pytest.approx(100 * 0.1 / 1.2, abs=1.5)


def _rows(psnrs: dict[tuple[str, str, str, str], float]) -> list[dict]:
    kinds = {"cube": "object", "bear": "object", "pad": "background"}
    return [
        {
            **dict.fromkeys(COLUMNS, ""),
            **{"scene": scene, "kind": kinds[scene], "binding": binding, "surface": surface, "seed": seed, "psnr": str(psnr)},
            **{"split": "held_out", "region": "masked", "origin": "mirror", "alpha_iou": "0.98"},
            "main": str(seed == "0").lower(),
        }
        for (scene, binding, surface, seed), psnr in psnrs.items()
    ]


PSNRS = {
    ("cube", "soft", "visual", "0"): 33.0,
    ("cube", "games", "visual", "0"): 31.0,
    ("cube", "soft", "visual", "1"): 32.0,
    ("cube", "games", "visual", "1"): 32.0,
    ("cube", "refined", "visual", "0"): 33.5,
    ("cube", "unbound", "visual", "0"): 34.0,
    ("bear", "soft", "visual", "0"): 29.0,
    ("bear", "games", "visual", "0"): 29.5,
    ("bear", "soft", "visual", "1"): 29.0,
    ("bear", "games", "visual", "1"): 29.0,
    ("cube", "soft", "hull", "1"): 30.0,
    ("cube", "games", "hull", "1"): 27.0,
    ("pad", "soft", "visual", "0"): 27.0,
    ("pad", "games", "visual", "0"): 27.04,
}


def test_rendering_figures_by_hand() -> None:
    figures = rendering_figures(_rows(PSNRS))
    value = {name: figure["value"] for name, figure in figures.items()}
    assert value["soft_minus_games_objects_min"] == pytest.approx(-0.25)
    assert value["soft_minus_games_objects_mean"] == pytest.approx((1.0 - 0.25) / 2)
    assert value["soft_minus_games_hull_mean"] == pytest.approx(3.0)
    assert value["soft_minus_games_backgrounds_min"] == pytest.approx(-0.04)
    assert value["refined_minus_soft_mean"] == pytest.approx(0.5)
    assert value["unbound_minus_refined_max"] == pytest.approx(0.5)
    assert value["soft_psnr_objects_min"] == pytest.approx(29.0)
    mean = figures["soft_minus_games_objects_mean"]
    assert (mean["n"], mean["seeds"]) == (2, 2)
    # Student's t of one degree of freedom is 12.706 at 97.5 %; the standard error of two values is half their distance.
    assert mean["interval"] == pytest.approx([0.375 - 12.706 * 0.625, 0.375 + 12.706 * 0.625], abs=1e-3)


def test_rasterizer_figures_are_taken_from_one_core_only(tmp_path: Path) -> None:
    whole = {"min_ms": 4.5, "median_ms": 5.0, "repeats": 60}
    step = {"min_ms": 16.0, "median_ms": 19.0, "repeats": 40, "speedup": 41.0}
    content = {"backend": "cpu", "threads": 1, "scenes": {"whole_50k_128": whole, "train_30k_256": step}}
    write_json(tmp_path / "r.json", {**content, "gradient_relative_error": {"means": 2e-6, "quats": 8e-6}})
    values = {name: figure["value"] for name, figure in rasterizer_figures(tmp_path / "r.json").items()}
    assert values == {
        "rasterizer_forward_min": 4.5,
        "rasterizer_forward_median": 5.0,
        "rasterizer_step_min": 16.0,
        "rasterizer_step_median": 19.0,
        "rasterizer_speedup": 41.0,
        "rasterizer_gradient_error": 8e-6,
    }
    assert set(values) <= set(read_floors(FLOORS))
    write_json(tmp_path / "r.json", {**content, "threads": 2})
    assert rasterizer_figures(tmp_path / "r.json") == {}


@pytest.mark.parametrize(
    ("measured", "preset", "met", "reason"),
    [
        (None, "desktop", False, "not measured"),
        ({"value": None, "n": 4, "seeds": 3}, "desktop", False, "not measured"),
        ({"value": 1.5, "n": 4, "seeds": 3}, "desktop", True, ""),
        ({"value": 1.0, "n": 4, "seeds": 3}, "desktop", True, ""),
        ({"value": 0.99, "n": 4, "seeds": 3}, "desktop", False, "outside the floor"),
        ({"value": 1.5, "n": 3, "seeds": 3}, "desktop", False, "measured on 3 of 4 scenes only"),
        ({"value": 1.5, "n": 4, "seeds": 1}, "desktop", False, "measured on 1 of 3 seeds only"),
        ({"value": 1.5, "n": 4, "seeds": 3}, "toy", False, "measured with preset toy, asked for preset desktop"),
    ],
)
def test_a_floor_is_met_only_by_a_full_measurement(measured: dict | None, preset: str, met: bool, reason: str) -> None:
    score = score_figure(read_floors(FLOORS)["soft_minus_games_objects_mean"], measured, preset)
    assert (score["met"], score["reason"]) == (met, reason)


def test_scores_and_page_from_files(tmp_path: Path, scored: dict) -> None:
    write_json(tmp_path / "cube.json", score_scene(**scored))
    write_rows(tmp_path / "rendering.csv", COLUMNS, _rows(PSNRS))
    ceilings = {"ceiling_db": {"32": 34.1, "128": 40.0}, "ceiling_masked_db": {"32": 33.0, "128": 36.0}}
    write_json(tmp_path / "film.json", {**ceilings, "frames": [{"spp": 32}, {"spp": 128}]})
    write_json(tmp_path / "real_sfm.json", {"registered": 14, "total": 16})
    write_json(tmp_path / "real_capture.json", {"decoded": None})
    write_real2sim_figures(
        tmp_path / "measured.json",
        scene_scores=[tmp_path / "cube.json"],
        rendering_csv=tmp_path / "rendering.csv",
        films={"cube": tmp_path / "film.json", "bear": tmp_path / "film.json"},
        real={"banana_photos": {"keyframes": tmp_path / "real_capture.json", "sfm": tmp_path / "real_sfm.json"}},
    )
    for preset, reason in (("desktop", "measured with preset desktop, asked for preset toy"), ("toy", "outside the floor")):
        out = tmp_path / f"{preset}.json"
        write_scores(FLOORS, [tmp_path / "measured.json"], out, area="real2sim", preset=preset, provenance=BEHIND)
        assert read_json(out)["figures"]["soft_below_ceiling_max"]["reason"] == reason
    scores = read_json(tmp_path / "desktop.json")["figures"]
    assert scores["soft_below_ceiling_max"]["value"] == pytest.approx(36.0 - 29.0)
    assert scores["banana_photos_registered"]["met"]
    assert scores["apple_video_registered_percent"]["reason"] == "not measured"
    assert {"value", "floor", "unit", "n", "interval", "met", "where", "preset"} <= set(scores["camera_error_median"])
    (tmp_path / "scores").mkdir()
    (tmp_path / "desktop.json").rename(tmp_path / "scores" / "real2sim.json")
    write_results_page(tmp_path / "scores", tmp_path / "RESULTS.md", dict.fromkeys(AREAS, BEHIND))
    text = (tmp_path / "RESULTS.md").read_text()
    assert "## real2sim" in text
    assert "## simulator\n\nNot recorded yet." in text
    assert "**unmet**: measured on 1 of 7 scenes only" in text
    assert all(f"`{name}`" in text for name, entry in read_floors(FLOORS).items() if entry["area"] == "real2sim")


def test_each_floor_takes_the_figure_of_its_own_preset(tmp_path: Path) -> None:
    figures = {"soft_below_ceiling_max": {"value": 9.0, "n": 4}, "soft_psnr_objects_min": {"value": 31.0, "n": 4}}
    write_json(tmp_path / "desktop.json", {"figures": figures})
    figures = {"soft_below_ceiling_max": {"value": 3.0, "n": 1}, "soft_psnr_objects_min": {"value": 28.0, "n": 1}}
    write_json(tmp_path / "toy.json", {"preset": "toy", "figures": figures})
    for files in (["desktop.json", "toy.json"], ["toy.json", "desktop.json"]):
        paths = [tmp_path / name for name in files]
        write_scores(FLOORS, paths, tmp_path / "s.json", area="real2sim", preset="desktop", provenance=BEHIND)
        scores = read_json(tmp_path / "s.json")["figures"]
        assert (scores["soft_below_ceiling_max"]["value"], scores["soft_below_ceiling_max"]["met"]) == (3.0, True)
        assert (scores["soft_psnr_objects_min"]["value"], scores["soft_psnr_objects_min"]["met"]) == (31.0, True)
    write_json(tmp_path / "bad.json", {"value": 1})
    with pytest.raises(InputError, match="no measured figures"):
        write_scores(FLOORS, [tmp_path / "bad.json"], tmp_path / "s.json", area="real2sim", preset="toy", provenance=BEHIND)


def test_floors_hold_every_figure_of_the_issue() -> None:
    floors = read_floors(FLOORS)
    wanted = {
        ("keyframes_registered_min", 95),
        ("camera_error_median", 1.2),
        ("camera_error_max", 2.5),
        ("scale_error_median", 0.25),
        ("scale_error_max", 0.5),
        ("tilt_max", 0.2),
        ("height_error_max", 1.0),
        ("mask_iou_mean_min", 0.95),
        ("mask_iou_min_min", 0.90),
        ("mask_iou_median", 0.97),
        ("chamfer_visual_max", 2.0),
        ("chamfer_visual_median", 1.3),
        ("chamfer_collision_max", 3.0),
        ("objects_watertight", 1),
        ("soft_minus_games_objects_min", 0.0),
        ("soft_minus_games_objects_mean", 1.0),
        ("soft_minus_games_hull_mean", 2.0),
        ("soft_minus_games_backgrounds_min", -0.05),
        ("refined_minus_soft_mean", 0.3),
        ("unbound_minus_refined_mean", 0.7),
        ("soft_psnr_objects_min", 30),
        ("soft_below_ceiling_max", 4),
        ("soft_alpha_iou_min", 0.97),
        ("rasterizer_forward_min", 5),
        ("rasterizer_forward_median", 6),
        ("rasterizer_step_min", 18),
        ("rasterizer_step_median", 22),
        ("rasterizer_speedup", 30),
        ("rasterizer_gradient_error", 1e-4),
    }
    assert wanted <= {(name, entry["floor"]) for name, entry in floors.items()}


@pytest.mark.parametrize(
    "entry", ["{}", "a: {floor: 1}", "a: {what: x, area: y, floor: high, direction: at_least, unit: '', preset: any, where: z}"]
)
def test_malformed_floors_are_refused(tmp_path: Path, entry: str) -> None:
    (tmp_path / "floors.yaml").write_text(entry)
    with pytest.raises(InputError):
        read_floors(tmp_path / "floors.yaml")


def test_the_page_in_the_repository_is_that_of_its_records(tmp_path: Path) -> None:
    folder = FLOORS.parent
    write_results_page(folder / "scores", tmp_path / "RESULTS.md", dict.fromkeys(AREAS, BEHIND))
    # Whether an area is fresh is the tree's matter: see tests/rules/test_provenance.py.
    written, kept = ((place / "RESULTS.md").read_text().splitlines() for place in (tmp_path, folder))
    assert [line.rsplit("|", 2)[0] for line in written] == [line.rsplit("|", 2)[0] for line in kept]


def test_an_area_is_fresh_until_its_code_or_its_settings_change() -> None:
    recorded = {"commit": "abc", "code": {"a": "1", "b": "2"}, "settings": {"seed": "3", "scenes.mug": "4"}}
    now = {"code": {"a": "1", "b": "2"}, "settings": {"seed": "3", "scenes.mug": "4", "scenes.bowl": "5"}}
    assert freshness("policies", recorded, now) == "fresh"
    assert changes("policies", recorded, {**now, "code": {"a": "1", "b": "0", "c": "2"}}) == ["b", "c"]
    assert changes("policies", recorded, {**now, "code": {"a": "1"}}) == ["b"]
    assert changes("policies", recorded, {**now, "settings": {"seed": "4"}}) == ["seed", "scenes.mug"]
    assert freshness("policies", recorded, {**now, "code": {"a": "0", "b": "2"}}) == "**stale** since `a` changed"
    many = {"code": dict.fromkeys("abcdefgh", "1"), "settings": {}}
    assert freshness("policies", many, {"code": {}, "settings": {}}).endswith("`f` and 2 more changed")
    assert "before digests" in freshness("policies", {"commit": "abc", "code": {}, "settings": {}}, now)
    # How the gap's benchmark is drawn changes no policy.
    drawn = {"commit": "abc", "code": {"a": "1"}, "settings": {"gap.methods": "5"}}
    assert changes("gap_rivals", drawn, {"code": {"a": "1"}, "settings": {"gap.methods": "6"}}) == ["gap.methods"]
    assert changes("gap", drawn, {"code": {"a": "1"}, "settings": {"gap.methods": "6"}}) == []
    assert changes("policies", drawn, {"code": {"a": "1"}, "settings": {"gap.methods": "6"}}) == []
    assert changes("policies", drawn, {"code": {"a": "1"}, "settings": {}}) == []


def test_an_area_is_stale_once_a_model_behind_it_is_edited() -> None:
    now = {"code": {"a": "1"}, "settings": {"seed": "3"}, "models": {"models/nominal.yaml": "6", "models/own.yaml": "7"}}
    assert freshness("policies", {"commit": "abc", **now}, now) == "fresh"
    edited = {**now, "models": {"models/nominal.yaml": "8", "models/own.yaml": "9"}}
    assert changes("policies", {"commit": "abc", **now}, edited) == ["models/nominal.yaml", "models/own.yaml"]
    # A variant that is added later leaves the others as they were.
    before = {**now, "models": {"models/nominal.yaml": "6"}}
    assert changes("policies", {"commit": "abc", **before}, now) == []
    # Records of the time before: nobody knows with which model they were made, unless the area reads none.
    old = {"commit": "abc", "code": {"a": "1"}, "settings": {"seed": "3"}}
    assert freshness("policies", old, now) == "**stale** since `models/nominal.yaml` changed"
    assert freshness("gap_real", old, {"code": {"a": "1"}, "settings": {"seed": "3"}}) == "fresh"


def test_the_page_lists_every_laboratory_and_the_present_one_is_the_configurations():
    told = read_json(ROOT / "benchmarks/laboratories.json")["laboratories"]
    worlds = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))["worlds"]
    # A laboratory that is drawn anew must say what was seen of the one before.
    assert {world["seed"] for name, world in worlds.items() if name.startswith("lab_")} == {told[-1]["seed"]}
    assert all(item["seen"] for item in told[:-1])
    page = laboratories_markdown(told)
    assert all(f"| {item['seed']} | {item['seen'] or 'nothing'} |" in page for item in told)
    assert laboratories_markdown([]) == ""
