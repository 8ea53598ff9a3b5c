"""Photos of two days as files: read, refused where something is wrong, diagnosed, put into the model, reported."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from gsbridge.cameras import Camera
from gsbridge.errors import InputError, StageError
from gsbridge.files import read_json
from gsbridge.gap.benchmark.images import film, hidden_pairs, image_site
from gsbridge.gap.image.files import read_pairs
from gsbridge.gap.image.pairs import ROLES
from gsbridge.gap.image.stages import amend_camera, write_image_findings
from gsbridge.images import write_image
from gsbridge.report.gap.picture_page import write_sight_report
from gsbridge.sim.model import read_model

SPIN = {"wr": 0.8, "wb": -0.6, "x": 0.6, "y": 0.8, "z": 0.0, "a": 0.0, "b": 0.0, "c": 1.0}
SHOTS = 3
NAMES = ("black_level", "exposure", "response", "shadow", "vignetting", "white_balance")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Photos of a camera that became darker by 0.3 EV, as a robot would leave them."""
    out = tmp_path_factory.mktemp("photos")
    site = image_site(7, camera=Camera(64, 48, 60.0, 60.0, 32.0, 24.0), photos=5)
    films = {role: film(3 + k, site.photos) for k, role in enumerate(ROLES)}
    takes = [hidden_pairs(site, {"exposure": 0.3}, films, SPIN, np.random.default_rng(k)) for k in range(SHOTS)]
    views, depths = [], []
    for role in ROLES:
        for n in range(site.photos):
            name = f"{role}-{n}"
            for k, take in enumerate(takes):
                write_image(out / "before" / f"{name}_{k}.png", take[role].before[n])
            write_image(out / "after" / f"{name}_0.png", takes[0][role].after[n])
            depths.append(takes[0][role].depths[n])
            views.append({"name": name, "role": role, "cam_from_world": takes[0][role].poses[n].tolist()})
    (out / "views").mkdir()
    (out / "views" / "views.json").write_text(json.dumps({"camera": site.camera.to_json(), "views": views}))
    np.savez(out / "views" / "depths.npz", depths=np.stack(depths))
    return out


@pytest.fixture
def copy(folder, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(folder, tmp_path / "photos")


def parts(folder):
    return folder / "views", folder / "before", folder / "after"


def test_photos_are_read_as_they_were_written(folder):
    pairs = read_pairs(*parts(folder))
    assert set(pairs) == set(ROLES)
    fit = pairs["fit"]
    assert fit.before.shape == (5, 48, 64, 3)
    assert fit.repeats == SHOTS - 1
    assert fit.after.mean() > 1.05 * fit.before.mean()
    assert np.abs(fit.again.mean() - fit.before.mean()) < 1e-3
    assert len({part.digest for part in pairs.values()}) == 3


def test_one_day_against_itself_keeps_the_later_photo_out_of_the_noise(folder):
    pairs = read_pairs(folder / "views", folder / "before", folder / "before", shot=2)
    assert pairs["fit"].repeats == SHOTS - 2
    assert np.abs(pairs["fit"].after - pairs["fit"].again).max() > 0


def edit(copy, change):
    content = json.loads((copy / "views/views.json").read_text())
    change(content)
    (copy / "views/views.json").write_text(json.dumps(content))


def test_names_that_begin_alike_are_told_apart(folder, copy):
    """Photos of another view, and files that are no photos of any, are left alone."""
    for shot in range(SHOTS):
        (copy / f"before/verify-0_{shot}.png").rename(copy / f"before/fit-0_b_{shot}.png")
    (copy / "after/verify-0_0.png").rename(copy / "after/fit-0_b_0.png")
    edit(copy, lambda content: content["views"][10].update(name="fit-0_b"))
    shutil.copy(copy / "before/verify-1_0.png", copy / "before/fit-0_old.png")
    pairs, wanted = read_pairs(*parts(copy)), read_pairs(*parts(folder))
    for role in ROLES:
        assert pairs[role].repeats == SHOTS - 1
        np.testing.assert_array_equal(pairs[role].before, wanted[role].before)
        np.testing.assert_array_equal(pairs[role].again, wanted[role].again)


def spoil_pose(copy):
    edit(copy, lambda content: content["views"][3].pop("cam_from_world"))


def spoil_role(copy):
    edit(copy, lambda content: content["views"][3].update(role="train"))


def spoil_name(copy):
    edit(copy, lambda content: content["views"][3].update(name=content["views"][2]["name"]))


def spoil_camera(copy):
    edit(copy, lambda content: content["camera"].pop("fx"))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (spoil_pose, ["views.json", "'fit-3' has no pose", "cam_from_world"]),
        (spoil_role, ["views.json", "'fit-3' has no role", "verify"]),
        (spoil_name, ["views.json", "two views are called 'fit-2'"]),
        (spoil_camera, ["views.json", "camera"]),
        (lambda copy: (copy / "after/select-1_0.png").unlink(), ["select-1_0.png", "does not exist"]),
        (lambda copy: (copy / "before/select-1_2.png").unlink(), ["before", "of some views there are 2 photos, of others 3"]),
        (lambda copy: [(copy / f"before/fit-1_{k}.png").unlink() for k in (1, 2)], ["1 photos of the view 'fit-1'"]),
        (lambda copy: write_image(copy / "after/fit-0_0.png", np.zeros((24, 32, 3))), ["fit-0_0.png", "32 x 24", "64 x 48"]),
        (lambda copy: np.savez(copy / "views/depths.npz", depths=np.ones((2, 48, 64))), ["depths.npz", "2 x 48 x 64"]),
        (lambda copy: np.savez(copy / "views/depths.npz", depth=np.ones(2)), ["depths.npz", "no depths"]),
        (lambda copy: (copy / "views/depths.npz").unlink(), ["depths.npz", "cannot be read"]),
        (lambda copy: (copy / "views/depths.npz").write_bytes(b""), ["depths.npz", "no depths"]),
        (lambda copy: np.savez(copy / "views/depths.npz", depths=np.zeros((15, 48, 64))), ["depths.npz", "no depth is known"]),
        (lambda copy: edit(copy, lambda c: c.update(camera="phone")), ["views.json", "no camera"]),
        (lambda copy: edit(copy, lambda c: c["camera"].update(fx=0)), ["views.json", "focal length"]),
        (
            lambda copy: edit(copy, lambda c: c["views"][3].update(cam_from_world=np.zeros((4, 4)).tolist())),
            ["views.json", "'fit-3' is no turn and shift"],
        ),
        (
            lambda copy: shutil.copy(copy / "before/fit-0_0.png", copy / "before/fit-0_00.png"),
            ["two photos of the view 'fit-0' have the number 0"],
        ),
    ],
)
def test_what_cannot_be_used_is_named_and_nothing_is_written(copy, tmp_path, spoil, words):
    spoil(copy)
    with pytest.raises(InputError) as error:
        write_image_findings(*parts(copy), tmp_path / "findings.json", tmp_path / "pictures.npz", seed=0)
    for word in words:
        assert word in str(error.value)
    assert not (tmp_path / "findings.json").exists()
    assert not (tmp_path / "pictures.npz").exists()


def test_what_changed_is_named_reported_and_learned(folder, tmp_path):
    files = [tmp_path / name for name in ("findings.json", "pictures.npz", "report.html", "model.yaml")]
    write_image_findings(*parts(folder), *files[:2], seed=0, names=NAMES)
    found = read_json(files[0])
    assert found["verdict"] == "named"
    assert [item["name"] for item in found["amended"]] == ["exposure"]
    assert found["amended"][0]["parameters"]["stops"] == pytest.approx(0.3, abs=0.02)
    write_sight_report("darker", *files[:3])
    page = files[2].read_text()
    assert found["sentence"][:20] in page
    assert page.count("data:image/png;base64,") == 1
    amend_camera("models/nominal.yaml", files[0], files[3])
    effects = read_model(files[3]).effects
    assert [effect.name for effect in effects] == ["exposure"]
    assert effects[0].parameters["stops"] == pytest.approx(found["amended"][0]["parameters"]["stops"])
    assert found["records"]["verify"] in files[3].read_text()


def test_nothing_is_found_in_photos_of_one_day_and_nothing_is_amended(folder, tmp_path):
    files = [tmp_path / name for name in ("findings.json", "pictures.npz", "report.html", "model.yaml")]
    write_image_findings(folder / "views", folder / "before", folder / "before", *files[:2], seed=0, shot=2, names=NAMES)
    found = read_json(files[0])
    assert found["verdict"] == "no_discrepancy"
    write_sight_report("same", *files[:3])
    assert "agree" in files[2].read_text()
    with pytest.raises(StageError, match="named nothing"):
        amend_camera("models/nominal.yaml", files[0], files[3])
    # As the reference of a later day it is what it should be; a finding there would stop everything.
    named = {**found, "verdict": "named", "amended": [{"name": "exposure", "parameters": {"stops": 0.3}}]}
    (tmp_path / "later.json").write_text(json.dumps(named))
    with pytest.raises(StageError, match="photos of one day differ"):
        amend_camera("models/nominal.yaml", tmp_path / "later.json", files[3], tmp_path / "later.json")
    amend_camera("models/nominal.yaml", tmp_path / "later.json", files[3], files[0])
    assert files[3].exists()
    files[3].unlink()
    assert not files[3].exists()


def test_an_effect_that_pictures_cannot_have_is_refused(tmp_path):
    found = {
        "amended": [{"name": "latency", "parameters": {"delay": 0.1}}],
        "verdict": "named", "sentence": "Late.", "records": {}, "seed": 0,
    }  # fmt: skip
    (tmp_path / "findings.json").write_text(json.dumps(found))
    with pytest.raises(InputError, match="'latency'"):
        amend_camera("models/nominal.yaml", tmp_path / "findings.json", tmp_path / "model.yaml")
    assert not (tmp_path / "model.yaml").exists()


def test_the_model_of_an_amended_camera_stays_readable(folder, tmp_path):
    write_image_findings(*parts(folder), tmp_path / "findings.json", tmp_path / "pictures.npz", seed=0, names=["exposure"])
    amend_camera("models/nominal.yaml", tmp_path / "findings.json", tmp_path / "model.yaml")
    nominal = yaml.safe_load(Path("models/nominal.yaml").read_text())
    content = yaml.safe_load((tmp_path / "model.yaml").read_text())
    assert {key: value for key, value in content.items() if key != "effects"} == {
        key: value for key, value in nominal.items() if key != "effects"
    }
