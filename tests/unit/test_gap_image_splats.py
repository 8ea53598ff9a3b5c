"""Photos against rendered pictures of the same states: the renderer's error is learnt, and effects beyond it are named."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from gsbridge.cameras import Camera, look_at
from gsbridge.errors import InputError
from gsbridge.gap.benchmark.image_truth import grainy
from gsbridge.gap.benchmark.images import _posed, film, image_site
from gsbridge.gap.diagnosis.results import ROLES
from gsbridge.gap.image.case import load_pairs, read_image_case, save_pairs
from gsbridge.gap.image.cells import Cells
from gsbridge.gap.image.diagnose import FEW, UNPROVEN, diagnose_splats
from gsbridge.gap.image.layers import LEVELS, LayerSpread, energies, numbers_of, weighed
from gsbridge.gap.image.pairs import Pairs
from gsbridge.gap.image.splat_error import FEWEST, learn_splat_error, reduced, subset
from gsbridge.gap.workflow import run_case
from gsbridge.images import linear_from_srgb, srgb_from_linear, write_image
from gsbridge.sim.model import read_model

CAMERA = Camera(96, 96, 123.0, 123.0, 48.0, 48.0)
NAMES = ("black_level", "exposure", "extrinsics", "vignetting", "white_balance")


def test_parts_of_pictures_are_orthogonal_and_add_up():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(2, 45, 37, 3)).astype(np.float32)
    np.testing.assert_allclose(weighed(values, np.ones((LEVELS, 3))), values, atol=1e-5)
    whole = (values.astype(float) ** 2).sum(axis=(0, 1, 2))
    np.testing.assert_allclose(energies(values).sum(axis=0), whole, rtol=1e-5)
    # Each part of white noise has energy in proportion to its number of coefficients; a part that is left out has none.
    assert numbers_of(45, 37).sum() == 45 * 37
    np.testing.assert_allclose((energies(values).sum(axis=1) / (6 * numbers_of(45, 37)))[:4], 1.0, rtol=0.4)
    weights = np.ones((LEVELS, 3))
    weights[2] = 0.0
    assert energies(weighed(values, weights))[2].max() < 1e-6 * whole.max()


def test_errors_that_are_alike_in_places_colours_and_views_become_white():
    """Smooth grey errors of each view, and one that all views of a day share, learnt from other days."""
    rng = np.random.default_rng(1)

    def day(views):
        smooth = np.stack([cv2.GaussianBlur(rng.normal(size=(48, 48)), (0, 0), 4.0) for _ in range(views + 1)])
        grey = 6.0 * smooth[:-1] + 4.0 * smooth[-1] + rng.normal() * 0.8
        return (np.repeat(grey[..., None], 3, axis=3) + rng.normal(size=(views, 48, 48, 3))).astype(np.float32)

    spread = LayerSpread.learn([day(8) for _ in range(12)])
    white = [spread.whitened(day(8)) for _ in range(12)]
    assert np.mean([(table**2).mean() for table in white]) == pytest.approx(1.0, rel=0.1)
    # A shift of all pixels was by far the largest error; after whitening, it is as likely as any other.
    shifts = np.array([table.sum() / np.sqrt(table.size) for table in white])
    assert 0.3 < shifts.std() < 2.0
    # With fewer views, the error that they share weighs less against the error of each.
    assert abs(spread.whitened(np.ones((8, 48, 48, 3), np.float32), 4).mean()) > abs(
        spread.whitened(np.ones((8, 48, 48, 3), np.float32), 16).mean()
    )


def test_what_is_left_is_averaged_by_cell_and_unknown_cells_are_told():
    keys = [np.array([3, 3, 7]), np.array([3, 9])]
    values = [np.array([[0.2] * 3, [0.4] * 3, [1.0] * 3]), np.array([[0.1] * 3, [0.5] * 3])]
    cells = Cells.learn(keys, values)
    mean, variance, known = cells.at(np.array([3, 8, 9]))
    # Two views of 0.3 and 0.1 beside two without any.
    assert mean[0] == pytest.approx([0.1] * 3)
    assert known.tolist() == [True, False, True]
    assert mean[1].tolist() == [0.0] * 3
    assert (variance[[0, 2]] > 0).all()


def drawn_of(site, plain, depths, poses):
    """What splats would show: softer, of other colours and exposure, off by place on the table."""
    rays, out = CAMERA.pixel_rays(), []
    rng = np.random.default_rng(site.seed)
    waves, phases = rng.uniform(10.0, 30.0, (3, 2)), rng.uniform(0.0, 6.3, 3)
    for photo, depth, pose in zip(plain, depths, poses, strict=True):
        light = cv2.GaussianBlur(linear_from_srgb(photo.astype(np.float32)), (0, 0), 0.9)
        places = (rays * depth[..., None] - pose[:3, 3]) @ pose[:3, :3]
        off = 1.0 + 0.06 * np.sin(places[..., :2] @ waves.T + phases)
        out.append(srgb_from_linear(np.clip(light * off * [1.1, 0.95, 0.85], 0.0, 1.0)))
    return np.stack(out).astype(np.float32)


@pytest.fixture(scope="module")
def takes():
    """Drawn pictures and photos of a day without a fault, and of other places on a later day; the hidden world makes more."""
    site, rng = image_site(7, camera=CAMERA, photos=8), np.random.default_rng(3)
    track, times = film(11, 36, duration=9.0)
    poses = track.at(times)
    depths = site.depths(poses, rng).astype(np.float32)
    posed = _posed((track, times), False)
    plain = site.lens().photos(*posed)
    drawn = drawn_of(site, plain, depths, poses)

    def later(hidden, spin=None):
        changed = site.lens(hidden, spin).photos(*posed)
        photos = np.where((np.arange(36) % 3 == 0)[:, None, None, None], plain, changed)
        return Pairs(CAMERA, drawn, drawn, grainy(photos, {}, rng), depths, poses, drawn=True)

    return later


def split(pairs):
    """Photos of the registration's day, and of each role."""
    day = [n for n in range(36) if n % 3 == 0]
    later = [n for n in range(36) if n % 3]
    parts = {role: subset(pairs, later[k::3]) for k, role in enumerate(ROLES)}
    return subset(pairs, day), parts


def test_splats_that_lack_detail_and_colours_raise_no_alarm_and_an_exposure_is_named(takes):
    registration, parts = split(takes({}))
    error = learn_splat_error(registration)
    drawn, calibrated, corrected = error.left
    assert corrected < calibrated < drawn
    quiet = diagnose_splats(parts, error, names=NAMES, seed=1)
    assert quiet.finding.verdict == "no_discrepancy"
    dark = diagnose_splats(split(takes({"exposure": -0.35}))[1], error, names=NAMES, seed=1)
    assert (dark.finding.verdict, dark.finding.best.names) == ("named", ("exposure",))
    assert dark.finding.best.fit.values[0]["stops"] == pytest.approx(-0.35, abs=0.03)
    # Without the learnt error the same photos would seem to lack much.
    assert dark.floor["model"] == corrected


@pytest.mark.parametrize("count", [FEWEST, FEWEST + 2])
def test_the_fewest_photos_that_are_accepted_tell_how_wrong_rendered_images_are(count):
    rng, camera = np.random.default_rng(0), Camera(48, 48, 60.0, 60.0, 24.0, 24.0)
    drawn = rng.uniform(0.2, 0.8, (count, 48, 48, 3)).astype(np.float32)
    photos = (drawn + rng.normal(0.0, 0.01, drawn.shape)).astype(np.float32)
    places = [np.array([0.1 * np.cos(a), 0.1 * np.sin(a), 0.4]) for a in np.linspace(0.0, 5.0, count)]
    poses = np.stack([look_at(place, np.zeros(3)) for place in places])
    day = Pairs(camera, drawn, drawn, photos, np.full((count, 48, 48), 0.4), poses, drawn=True)
    # Photos differ from the images by this noise alone.
    assert learn_splat_error(day).left[2] == pytest.approx(0.01, rel=0.05)
    with pytest.raises(InputError, match=f"{FEWEST - 1} photos of the day"):
        learn_splat_error(subset(day, range(FEWEST - 1)))


def test_reduced_pictures_keep_lengths_in_pixels_of_the_camera(takes):
    registration, _ = split(takes({}))
    small = reduced(registration)
    assert (small.camera.width, small.edge) == (48, 2)
    assert small.camera.fx == pytest.approx(61.5)
    unknown = registration.depths.copy()
    unknown[:, 10, 10] = 0.0
    assert (reduced(replace(registration, depths=unknown)).depths[:, 5, 5] == 0).all()


@pytest.fixture(scope="module")
def folder(takes, tmp_path_factory):
    """A case as files: a camera that became darker by a third of a stop."""
    out, pairs = tmp_path_factory.mktemp("splats"), takes({"exposure": -0.35})
    (out / "views").mkdir()
    views = []
    for n in range(36):
        role, name = ("registration" if n % 3 == 0 else ROLES[n // 3 % 3]), f"{n:02d}"
        write_image(out / "views" / f"{name}.png", pairs.before[n])
        write_image(out / ("well" if n % 3 == 0 else "now") / f"{name}_0.png", pairs.after[n])
        views.append({"name": name, "role": role, "cam_from_world": pairs.poses[n].tolist()})
    (out / "views" / "views.json").write_text(json.dumps({"camera": CAMERA.to_json(), "views": views}))
    np.savez(out / "views" / "depths.npz", depths=pairs.depths)
    model = yaml.safe_load(Path("models/nominal.yaml").read_text(encoding="utf-8"))
    (out / "model.yaml").write_text(yaml.safe_dump(model))
    case = {"model": "model.yaml", "photos": {"views": "views", "registration": "well", "after": "now"}, "effects": list(NAMES)}
    (out / "photos.yaml").write_text(yaml.safe_dump(case))
    return out


def test_a_case_of_drawn_pictures_is_read_kept_and_diagnosed(folder, tmp_path):
    case = read_image_case(folder / "photos.yaml")
    assert len(case.registration) == 12
    assert case.reasons == (UNPROVEN, FEW)
    assert {len(part) for part in case.pairs.values()} == {8}
    save_pairs(tmp_path / "records.npz", {**case.pairs, "registration": case.registration})
    again = load_pairs(tmp_path / "records.npz")
    assert again["registration"].drawn
    np.testing.assert_array_equal(again["fit"].after, case.pairs["fit"].after)
    found = run_case(folder / "photos.yaml", tmp_path / "out", tmp_path / "bank", seed=1)
    assert (found["verdict"], found["status"]) == ("named", "degraded")
    assert [item["name"] for item in found["amended"]] == ["exposure"]
    rms = found["model_error"]["rms"]
    assert rms["corrected"] < rms["drawn"]
    assert [effect.name for effect in read_model(tmp_path / "out" / "model.yaml").effects] == ["exposure"]


def spoil_drawn(copy):
    (copy / "views/01.png").unlink()


def spoil_registration(copy):
    shutil.rmtree(copy / "well")


def spoil_number(copy):
    for path in sorted((copy / "well").iterdir())[8:]:
        path.unlink()


def spoil_key(copy):
    case = yaml.safe_load((copy / "photos.yaml").read_text())
    case["photos"]["before"] = "well"
    (copy / "photos.yaml").write_text(yaml.safe_dump(case))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (spoil_drawn, "01.png"),
        (spoil_registration, "holds no photo of a view"),
        (spoil_number, "there are 8 photos of the day on which all was well"),
        (spoil_key, "'photos.before' is unknown"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(folder, tmp_path, spoil, words):
    copy = shutil.copytree(folder, tmp_path / "copy")
    spoil(copy)
    with pytest.raises(InputError, match=words):
        read_image_case(copy / "photos.yaml")
