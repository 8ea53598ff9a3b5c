"""Exposure and white balance of single photos: the formulas, the fit of halves, and a film that re-exposes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from ball_scene import RADIUS, VIEWS, held_out, targets
from test_train import TINY, scene  # noqa: F401  (a fixture)

from gsbridge.asset.photos import AssetPhotos, compare_with_photos
from gsbridge.cameras import Views
from gsbridge.errors import InputError
from gsbridge.images import linear_from_srgb, read_image_u8, srgb_from_linear, write_image
from gsbridge.meshes import Mesh
from gsbridge.splats import train as trainer
from gsbridge.splats.brightness import NOTICEABLE, brightness, spread
from gsbridge.splats.evaluate import evaluate_cloud
from gsbridge.splats.exposure import NEUTRAL, Exposure, Exposures, exposed, fitted, from_record, to_record
from gsbridge.splats.ply import read_ply
from gsbridge.splats.stage import train_splats


def test_an_exposure_is_a_gain_and_an_offset_of_linear_light() -> None:
    colours = np.random.default_rng(0).random((200, 3)).astype(np.float32)
    exposure = Exposure(np.array([0.6, 1.1, 1.4]), np.array([0.01, 0.0, -0.002]))
    light = np.maximum(linear_from_srgb(colours) * exposure.gains + exposure.offsets, -1)
    np.testing.assert_allclose(exposure.apply(colours), srgb_from_linear(light), atol=2e-6)
    np.testing.assert_allclose(NEUTRAL.apply(colours), colours, atol=2e-6)


def test_gradients_of_an_exposure() -> None:
    colours = torch.cat([torch.zeros(1, 3), torch.rand(9, 3)]).double().requires_grad_()
    gains, offsets = torch.tensor([0.7, 1.0, 1.3]).double().requires_grad_(), torch.full((3,), 0.01).double().requires_grad_()
    assert torch.autograd.gradcheck(exposed, (colours[1:].detach().requires_grad_(), gains, offsets))
    exposed(colours, gains, offsets).sum().backward()
    assert bool(torch.isfinite(colours.grad).all())


def test_a_fit_finds_the_exposure_and_one_colour_gives_a_gain() -> None:
    light = np.random.default_rng(1).random((3000, 3)) * 0.8
    exposure = Exposure(np.array([0.5, 1.0, 1.5]), np.zeros(3))
    found = fitted(light, light * exposure.gains)
    np.testing.assert_allclose(found.gains, exposure.gains, atol=0.01)
    np.testing.assert_allclose(found.offsets, 0, atol=0.004)
    flat = np.full((3000, 3), 0.2)
    found = fitted(flat, 0.7 * flat)
    np.testing.assert_allclose(found.gains, 0.7, atol=0.02)
    assert fitted(light[:10], 2 * light[:10]) is NEUTRAL


def test_exposures_have_a_mean_of_one() -> None:
    exposures = Exposures(["a", "b", "c"])
    exposures.parameters["exposure_gains"] += torch.rand(3, 3)
    exposures.parameters["exposure_offsets"] += 0.1 * torch.rand(3, 3)
    found = exposures.found()
    np.testing.assert_allclose(np.prod([e.gains for e in found.values()], axis=0), 1, atol=1e-6)
    np.testing.assert_allclose(np.sum([e.offsets for e in found.values()], axis=0), 0, atol=1e-7)
    back = from_record(json.loads(json.dumps(to_record(found))))
    assert back is not None
    np.testing.assert_array_equal(back["b"].gains, found["b"].gains)
    assert from_record(None) is None


def drawn_gains() -> np.ndarray:
    """A phone that re-exposes by a third of a stop or so, and its white balance; the brightest photo is not clipped."""
    rng = np.random.default_rng(0)
    return 0.8 * np.exp(rng.normal(0, 0.25, (VIEWS, 1)) + rng.normal(0, 0.06, (VIEWS, 3)))


def test_a_film_that_re_exposes_is_shown_as_well_as_a_locked_one(tmp_path: Path) -> None:
    gains = drawn_gains()
    locked = held_out(targets(0.0, gains=np.full_like(gains, 0.8)), tmp_path / "locked")[0]
    smeared = held_out(targets(0.0, gains=gains), tmp_path / "smeared")[0]
    fit, exposures = held_out(targets(0.0, gains=gains), tmp_path / "fit", per_photo=True)
    assert fit > locked - 0.5
    assert fit > smeared + 3
    assert exposures is not None
    found = np.log([e.gains for e in exposures.found().values()])
    true = np.log(gains[[int(Path(name).stem) for name in exposures.names]])
    assert np.sqrt(((found - true + true.mean(0)) ** 2).mean()) < 0.08


def test_a_locked_film_loses_next_to_nothing(tmp_path: Path) -> None:
    photos = targets(0.0, gains=np.full((VIEWS, 3), 0.8))
    assert held_out(photos, tmp_path, per_photo=True)[0] > held_out(photos, tmp_path)[0] - 0.2


def ball() -> Mesh:
    sphere = trimesh.creation.icosphere(3, RADIUS)
    return Mesh(np.asarray(sphere.vertices), np.asarray(sphere.faces))


def test_brightness_of_photos_is_told_by_the_places_that_they_share() -> None:
    gains = drawn_gains()
    photos = targets(0.0, gains=gains)
    found = brightness(ball(), photos)
    assert sorted(found) == [photo.name for photo in photos if photo.split == "train"]
    true = np.log([gains[int(Path(name).stem)] for name in found])
    error = np.array(list(found.values())) - true
    assert np.abs(error - np.median(error, axis=0)).max() < 0.04
    assert spread(list(found.values())) == pytest.approx(true.std(0).max(), rel=0.05)
    # A single photo tells nothing.
    assert brightness(ball(), photos[:1]) == {}


def test_a_white_balance_that_drifts_is_a_difference_of_brightness_too() -> None:
    drift = np.exp(np.linspace(-0.2, 0.2, VIEWS))
    photos = targets(0.0, gains=0.8 * np.stack([drift, np.ones(VIEWS), 1.0 / drift], axis=1))
    found = spread(list(brightness(ball(), photos).values()))
    assert found == pytest.approx(np.log(drift).std(), rel=0.1)
    assert found > NOTICEABLE


@pytest.mark.parametrize(("sheen", "most"), [(0.0, 0.01), (0.3, NOTICEABLE)])
def test_highlights_that_wander_are_no_exposure(sheen: float, most: float) -> None:
    assert spread(list(brightness(ball(), targets(sheen)).values())) < most


@pytest.mark.parametrize("darkened", [0, 5])
def test_photos_that_differ_in_brightness_get_exposures_of_their_own(scene, darkened: int) -> None:  # type: ignore[no-untyped-def]  # noqa: F811
    folder, views = scene
    for view in [view for view in views if view.split == "train"][:darkened]:
        dark = 0.5 * linear_from_srgb(read_image_u8(views.path(view)) / 255.0)
        write_image(views.path(view), np.rint(255 * srgb_from_linear(dark)).astype(np.uint8))
    out = folder / "out"
    files = (folder / "mesh.ply", out / "splats.ply", out / "binding.npz", out / "views", out / "splats.json")
    train_splats(views, folder / "masks", *files, TINY, "soft", seed=0, threads=1, state=folder / "s", kind="object")
    record = json.loads((out / "splats.json").read_text())
    assert ("exposure" in record) == (darkened > 0)
    assert (record["brightness_spread"] > 0.2) == (darkened > 0)


def test_a_half_never_tells_its_own_exposure(scene) -> None:  # type: ignore[no-untyped-def]  # noqa: F811
    """A photo whose right half is darker: each half gets what the other one needs, which is worse than nothing."""
    folder, views = scene
    whole = trainer_targets(views, folder)
    model = trained(whole, folder)
    photo = next(target for target in whole if target.split == "held_out")
    image = photo.photo.copy()
    middle = image.shape[1] // 2
    image[:, middle:] = np.rint(255 * srgb_from_linear(0.5 * linear_from_srgb(image[:, middle:] / 255.0)))
    split = replace(photo, photo=image, unedited=image)

    def score(target, exposures):  # type: ignore[no-untyped-def]
        return evaluate_cloud(model, [target], kind="object", exposures=exposures)["held_out"]["full"]["psnr"]

    assert score(split, {}) < score(split, None) - 1
    assert score(photo, {}) > score(photo, None) - 0.5


def trainer_targets(views: Views, folder: Path):  # type: ignore[no-untyped-def]
    from gsbridge.splats.targets import object_targets

    return object_targets(views, folder / "masks", 4)


def trained(photos, folder: Path):  # type: ignore[no-untyped-def]
    """Splats of the fixture's ball."""
    from test_train import ball_mesh

    from gsbridge.splats.binding import create_binding

    binding = create_binding("soft", ball_mesh(), 1, band=0.01, seed=0)
    rates = trainer.Rates(opacity=0.15, colour=0.06)
    trainer.train(binding, photos, TINY, kind="object", seed=0, state=folder / "state", rates=rates)
    return binding.evaluate()


def test_the_stage_says_how_photos_were_scored_and_the_asset_is_compared_alike(scene) -> None:  # type: ignore[no-untyped-def]  # noqa: F811
    folder, views = scene
    out = folder / "out"
    files = (folder / "mesh.ply", out / "splats.ply", out / "binding.npz", out / "views", out / "splats.json")
    settings = TINY.model_copy(update={"exposure": "per_photo", "sh_degree": 1})
    train_splats(views, folder / "masks", *files, settings, "refined", seed=0, threads=1, state=folder / "s", kind="object")
    record = json.loads((out / "splats.json").read_text())
    assert "fitted to its other half" in record["exposure"]["held_out"]
    assert sorted(record["exposure"]["photos"]) == [view.name for view in views if view.split == "train"]
    assert record["sh_degree"] == 1
    photos = AssetPhotos(views, folder / "masks", out / "splats.json", settings.margin_px)
    looks = compare_with_photos(read_ply(out / "splats.ply"), np.eye(4), photos, kind="object", visual=folder / "mesh.ply")
    assert looks["kept"]
    assert looks["psnr"] == pytest.approx(looks["stage_psnr"], abs=0.02)
    record["exposure"] = {"photos": [1]}
    (out / "splats.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match="no metrics"):
        compare_with_photos(read_ply(out / "splats.ply"), np.eye(4), photos, kind="object", visual=folder / "mesh.ply")


def test_a_killed_training_goes_on_with_its_exposures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    photos = targets(0.0, gains=drawn_gains())
    monkeypatch.setattr(trainer, "CHECKPOINT_EVERY", 10)
    whole = held_out(photos, tmp_path / "whole", per_photo=True, degree=1, steps=30)
    calls, original = [], trainer.rasterize

    def killed(*arguments, **options):  # type: ignore[no-untyped-def]
        calls.append(1)
        if len(calls) == 24:
            raise KeyboardInterrupt
        return original(*arguments, **options)

    monkeypatch.setattr(trainer, "rasterize", killed)
    with pytest.raises(KeyboardInterrupt):
        held_out(photos, tmp_path / "broken", per_photo=True, degree=1, steps=30)
    again = held_out(photos, tmp_path / "broken", per_photo=True, degree=1, steps=30)
    assert again[0] == whole[0]
    assert again[1] is not None
    assert whole[1] is not None
    for name, value in whole[1].parameters.items():
        assert torch.equal(value, again[1].parameters[name]), name
