"""Training on a tiny scene: it learns, resumes to the same result, and leaves the stage's files."""

import json

import numpy as np
import pytest
import torch
import trimesh

from gsbridge.cameras import Camera, View, Views, look_at, split_of
from gsbridge.configuration.splats import SplatSettings
from gsbridge.errors import InputError, StageError
from gsbridge.images import write_image
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.splats import train as trainer
from gsbridge.splats.binding import create_binding, read_binding
from gsbridge.splats.evaluate import evaluate_cloud, render_cloud
from gsbridge.splats.ply import read_ply
from gsbridge.splats.stage import train_splats
from gsbridge.splats.targets import Target, background_targets, object_targets, seen_faces
from gsbridge.splats.train import Rates

SIZE = 48


def ball_mesh(radius: float = 0.05) -> Mesh:
    ball = trimesh.creation.icosphere(3, radius)
    return Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))


@pytest.fixture
def scene(tmp_path):
    """A ball of radius 50 mm whose colour changes with height, seen by nine cameras; shaded analytically."""
    camera = Camera(SIZE, SIZE, 90.0, 90.0, SIZE / 2, SIZE / 2)
    views = []
    for i in range(9):
        angle = 2 * np.pi * i / 9
        eye = np.array([0.25 * np.cos(angle), 0.25 * np.sin(angle), 0.12])
        pose = look_at(eye, np.zeros(3))
        direction = camera.pixel_rays() @ pose[:3, :3]
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        along = -(direction @ eye)
        inside = along**2 - eye @ eye + 0.05**2
        point = eye + direction * (along - np.sqrt(np.maximum(inside, 0)))[..., None]
        mask = inside > 0
        height = point[..., 2] / 0.05
        ball = np.stack([0.5 + 0.4 * height, 0.6 - 0.3 * height, np.full_like(height, 0.3)], axis=-1)
        name = f"{i:04d}.png"
        write_image(tmp_path / "images" / name, np.where(mask[..., None], ball, 0.8))
        write_image(tmp_path / "masks" / name, mask.astype(np.float32))
        views.append(View(name, camera, pose, split_of(i)))
    write_mesh(tmp_path / "mesh.ply", ball_mesh())
    return tmp_path, Views(tmp_path / "images", tuple(views))


TINY = SplatSettings(max_splats=400, steps=60, margin_px=4)


def test_training_shows_the_ball_and_nothing_beside_it(scene):
    folder, views = scene
    targets = object_targets(views, folder / "masks", 4)
    binding = create_binding("soft", ball_mesh(), 1, band=0.01, seed=0)
    settings = SplatSettings(steps=120)
    rates = Rates(opacity=0.15, colour=0.06)
    curve = trainer.train(binding, targets, settings, kind="object", seed=0, state=folder / "state", rates=rates)
    metrics = evaluate_cloud(binding.evaluate(), targets, kind="object")
    assert curve[-1][1] < 0.5 * curve[0][1]
    assert metrics["held_out"]["masked"]["views"] == 1
    assert metrics["held_out"]["masked"]["psnr"] > 20
    assert metrics["held_out"]["full"]["alpha_iou"] > 0.93
    alphas = render_cloud(binding.evaluate(), views[0].camera, views[0].cam_from_table)[1]
    assert alphas[0].max() < 0.02
    assert alphas[SIZE // 2, SIZE // 2] > 0.8


def test_a_killed_training_resumes_to_the_same_result(scene, monkeypatch):
    folder, views = scene
    targets = object_targets(views, folder / "masks", 4)
    monkeypatch.setattr(trainer, "CHECKPOINT_EVERY", 10)

    def run(state):
        binding = create_binding("refined", ball_mesh(), 1, band=0.01, seed=3)
        curve = trainer.train(binding, targets, SplatSettings(steps=30), kind="object", seed=3, state=folder / state)
        return binding.parameters, curve

    whole, curve = run("whole")
    steps = []

    def killed(*arguments, **options):
        steps.append(1)
        if len(steps) == 24:
            raise KeyboardInterrupt
        return original(*arguments, **options)

    original = trainer.rasterize
    monkeypatch.setattr(trainer, "rasterize", killed)
    with pytest.raises(KeyboardInterrupt):
        run("broken")
    again, curve_again = run("broken")
    assert len(steps) == 24 + 10
    assert curve_again == curve
    for name, value in whole.items():
        assert torch.equal(value, again[name]), name


def test_a_damaged_or_foreign_checkpoint_is_not_used(scene):
    folder, views = scene
    targets = object_targets(views, folder / "masks", 4)
    (folder / "state").mkdir()
    (folder / "state" / "checkpoint.pt").write_bytes(b"damaged")
    binding = create_binding("games", ball_mesh(), 1, band=0.01, seed=0)
    curve = trainer.train(binding, targets, SplatSettings(steps=2), kind="object", seed=0, state=folder / "state")
    assert curve[-1][0] == 2


def test_a_checkpoint_of_other_photos_is_not_continued(scene, monkeypatch):
    """The same number of splats does not make it the same training."""
    folder, views = scene
    targets = object_targets(views, folder / "masks", 4)
    monkeypatch.setattr(trainer, "CHECKPOINT_EVERY", 2)
    settings, steps = SplatSettings(steps=4), []
    original = trainer.rasterize
    monkeypatch.setattr(trainer, "rasterize", lambda *a, **k: steps.append(1) or original(*a, **k))

    def run(inputs):
        steps.clear()
        binding = create_binding("games", ball_mesh(), 1, band=0.01, seed=0)
        trainer.train(binding, targets, settings, kind="object", seed=0, state=folder / "state", inputs=inputs)
        return len(steps)

    assert run("these") == 4
    assert run("these") == 0
    assert run("those") == 4


def test_metrics_of_a_known_error(scene):
    """A black frame, no splat in sight: the error is the photo itself."""
    folder, views = scene
    target = object_targets(views, folder / "masks", 4)[0]
    far = create_binding("games", ball_mesh(), 1, band=0.01, seed=0).evaluate()
    far = type(far)(far.means + np.float32(100), far.quats, far.scales, far.opacities, far.colours)
    metrics = evaluate_cloud(far, [target], kind="object")["train"]
    squared = ((target.photo / 255.0) ** 2).mean(-1)[target.weight > 127]
    assert metrics["full"]["psnr"] == pytest.approx(-10 * np.log10(squared.sum() / SIZE**2), abs=1e-3)
    assert metrics["full"]["alpha_iou"] == 0
    assert metrics["full"]["lpips"] is None


def test_masked_error_is_that_of_the_object_in_its_place():
    """Where no splat shows, the photo's own background does, beside the object and through it."""
    camera = Camera(40, 40, 60.0, 60.0, 20.0, 20.0)
    photo = np.full((40, 40, 3), 60, np.uint8)
    weight = np.zeros((40, 40), np.uint8)
    weight[16:24, 16:24] = 255
    photo[16:24, 16:24] = 200
    target = Target("a.png", "held_out", camera, np.eye(4), photo, weight, photo, 0, 0, camera)
    far = create_binding("games", ball_mesh(), 1, band=0.01, seed=0).evaluate()
    far = type(far)(far.means - np.float32(100), far.quats, far.scales, far.opacities, far.colours)
    masked = evaluate_cloud(far, [target], kind="object")["held_out"]["masked"]
    assert masked["psnr"] == pytest.approx(-20 * np.log10(140 / 255), abs=0.05)


def test_the_stage_leaves_its_files(scene):
    folder, views = scene
    out = folder / "out"

    def run(kind, masks, settings=TINY):
        train_splats(
            views,
            masks,
            folder / "mesh.ply",
            out / "splats.ply",
            out / "binding.npz",
            out / "views",
            out / "splats.json",
            settings,
            "soft",
            seed=0,
            threads=1,
            state=folder / "state",
            kind=kind,
        )
        return json.loads((out / "splats.json").read_text())

    record = run("object", folder / "masks")
    assert record["status"] == "pass"
    assert record["splats"] == len(read_ply(out / "splats.ply")) <= TINY.max_splats
    np.testing.assert_allclose(
        read_binding(out / "binding.npz").evaluate().means, read_ply(out / "splats.ply").means, atol=1e-6
    )
    assert [path.name for path in (out / "views").iterdir()] == record["pictures"]
    assert record["lpips_reason"]
    assert not (folder / "state").exists()
    assert "chosen_splats" not in record
    counted = run("object", folder / "masks", TINY.model_copy(update={"max_splats": "auto", "most_splats": 300}))
    assert counted["splats"] <= counted["chosen_splats"] == 300
    background = run("background", None)
    assert background["metrics"]["held_out"]["masked"]["psnr"] > 12
    assert background["metrics"]["held_out"]["full"]["alpha_iou"] is None
    with pytest.raises(InputError, match="needs masks"):
        run("object", None)


def test_targets_refuse_what_does_not_fit(scene):
    folder, views = scene
    write_image(folder / "masks" / "0000.png", np.zeros((SIZE, SIZE + 2), np.float32))
    with pytest.raises(InputError, match="pixels"):
        object_targets(views, folder / "masks", 4)
    for view in views:
        write_image(folder / "masks" / view.name, np.zeros((SIZE, SIZE), np.float32))
    with pytest.raises(StageError, match="empty mask"):
        object_targets(views, folder / "masks", 4)
    aside = ball_mesh()
    with pytest.raises(StageError, match="sees the mesh"):
        background_targets(views, Mesh(aside.vertices + 100, aside.faces))


def test_background_pixels_count_where_their_ray_meets_the_mesh(scene):
    _, views = scene
    target = background_targets(views, ball_mesh())[0]
    # The silhouette of a ball of 50 mm at 277 mm: a cone of 10.4 degrees, here 90 tan(10.4 deg) = 16.5 px in radius.
    area = (target.weight > 0).sum()
    assert area == pytest.approx(np.pi * 16.5**2, rel=0.04)


def test_faces_are_seen_from_the_front_and_where_nothing_hides_them():
    camera = Camera(40, 40, 60.0, 60.0, 20.0, 20.0)
    ball = ball_mesh()
    shade = np.array([[-1, -1, 0.06], [1, -1, 0.06], [1, 0.0, 0.06], [-1, 0.0, 0.06]])
    both = Mesh(np.r_[ball.vertices, shade], np.r_[ball.faces, np.array([[0, 1, 2], [0, 2, 3]]) + len(ball.vertices)])
    pose = look_at(np.array([0.0, 0.0, 0.3]), np.zeros(3), up=(0.0, 1.0, 0.0))
    photo, weight = np.zeros((40, 40, 3), np.uint8), np.zeros((40, 40), np.uint8)
    target = Target("a.png", "train", camera, pose, photo, weight, photo, 0, 0, camera)
    centroids = ball.corners().mean(1)
    facing = ((np.array([0, 0, 0.3]) - centroids) * ball.normals()).sum(1) > 0
    # The shade covers the half y < 0, seen from above; keep clear of its edge, which perspective shifts.
    np.testing.assert_array_equal(seen_faces(ball, [target]), facing)
    clear = np.abs(centroids[:, 1]) > 0.01
    seen = seen_faces(both, [target])[: len(ball.faces)]
    np.testing.assert_array_equal(seen[clear], (facing & (centroids[:, 1] > 0))[clear])


def test_reducing_a_background_keeps_rays_and_drops_partly_covered_pixels():
    camera = Camera(8, 6, 10.0, 10.0, 4.0, 3.0)
    weight = np.zeros((6, 8), np.uint8)
    weight[:, :5] = 255
    grey = np.full((6, 8, 3), 90, np.uint8)
    target = Target("a.png", "train", camera, np.eye(4), grey, weight, grey, 0, 0, camera)
    half = target.reduced(0.5, kind="background")
    assert (half.camera.width, half.camera.height, half.camera.fx, half.camera.cx) == (4, 3, 5.0, 2.0)
    np.testing.assert_array_equal(half.weight[0], [255, 255, 0, 0])
    assert target.reduced(1.5, kind="background") is target


def test_reducing_an_object_keeps_its_outline_free_of_the_background():
    camera = Camera(8, 6, 10.0, 10.0, 4.0, 3.0)
    weight = np.zeros((6, 8), np.uint8)
    weight[:, :5] = 255
    photo = np.full((6, 8, 3), 255, np.uint8)
    photo[:, :5] = 40
    half = Target("a.png", "train", camera, np.eye(4), photo, weight, photo, 0, 0, camera).reduced(0.5, kind="object")
    np.testing.assert_array_equal(half.weight[0], [255, 255, 128, 0])
    np.testing.assert_array_equal(half.photo[0, :3], 40)
