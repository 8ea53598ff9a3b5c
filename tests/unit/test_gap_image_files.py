"""Photos of two days as files: read, refused where something is wrong, diagnosed, put into the model, reported."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from browser import BROWSER, check
from recording_file import read_recording

from gsbridge.cameras import Camera
from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.errors import InputError, StageError
from gsbridge.files import read_json
from gsbridge.gap.benchmark.images import film, hidden_pairs, image_site
from gsbridge.gap.diagnosis.results import ROLES
from gsbridge.gap.formats.files import case_files
from gsbridge.gap.image.doubts import shared_photos
from gsbridge.gap.image.files import read_pairs
from gsbridge.gap.image.residuals import ImageResiduals, compared, learn_noise
from gsbridge.gap.image.workflow import amend_camera, write_image_findings
from gsbridge.gap.workflow import (
    load_backend,
    read_backend,
    write_case_records,
    write_comparison,
    write_findings,
    write_replays,
    write_screening,
)
from gsbridge.images import write_image
from gsbridge.report.gap.page import CaseFiles, write_gap_report
from gsbridge.report.gap.picture_page import write_picture_report
from gsbridge.report.gap.rows import gap_row
from gsbridge.report.recordings.gap import record_gap
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


def test_pictures_that_stand_for_two_views_are_told(copy):
    assert shared_photos(read_pairs(*parts(copy))) == ()
    shutil.copy(copy / "after/fit-0_0.png", copy / "after/verify-2_0.png")
    shutil.copy(copy / "after/select-0_0.png", copy / "after/select-3_0.png")
    shutil.copy(copy / "before/verify-1_0.png", copy / "after/verify-1_0.png")
    assert shared_photos(read_pairs(*parts(copy))) == (
        "two views of 'select' share a picture, so that it proves nothing: take other photos",
        "a later photo of 'verify' is a copy of an earlier one",
        "'fit' and 'verify' share a picture, so that it proves nothing: take other photos",
    )


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


def write_depths(copy, change):
    with np.load(copy / "views/depths.npz") as content:
        depths = content["depths"]
    np.savez(copy / "views/depths.npz", depths=change(depths))


def roughen_depths(copy, noise=0.01):
    """As a depth camera gives them: right to a percent, but each pixel by itself."""
    write_depths(copy, lambda depths: depths * (1 + noise * np.random.default_rng(0).standard_normal(depths.shape)))


def test_depths_as_smooth_as_the_page_asks_leave_what_can_be_compared(folder, copy):
    """docs/gap_images.md and the error about rough depths give this limit."""
    whole = compared(read_pairs(*parts(folder))["fit"]).mean()
    roughen_depths(copy, 0.001)
    assert compared(read_pairs(*parts(copy))["fit"]).mean() > 0.9 * whole


FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def read_poses_as(copy, convention):
    """Write the poses of all views by another convention."""

    def change(content):
        for view in content["views"]:
            view["cam_from_world"] = convention(np.array(view["cam_from_world"])).tolist()

    edit(copy, change)


def in_millimetres(pose):
    return np.block([[pose[:3, :3], 1e3 * pose[:3, 3:]], [pose[3:]]])


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (spoil_pose, ["views.json", "'fit-3' has no pose", "cam_from_world"]),
        (spoil_role, ["views.json", "'fit-3' has no such role: 'train'", "verify"]),
        (lambda copy: edit(copy, lambda c: c["views"][3].pop("role")), ["views.json", "'fit-3' has no role", "verify"]),
        (spoil_name, ["views.json", "two views are called 'fit-2'"]),
        (spoil_camera, ["views.json", "camera"]),
        (lambda copy: edit(copy, lambda c: c["camera"].update(k1=-0.3)), ["views.json", "'k1' is no key of its 'camera'"]),
        (lambda copy: edit(copy, lambda c: c["camera"].update(fx=2.1, fy=2.1)), ["views.json", "a focal length fx of 2.1 px"]),
        (lambda copy: edit(copy, lambda c: c["camera"].update(cx=999)), ["views.json", "a principal point at cx = 999 px"]),
        (lambda copy: shutil.rmtree(copy / "before"), ["before", "the folder of photos does not exist"]),
        (
            lambda copy: [(copy / f"before/fit-1_{k}.png").rename(copy / f"before/fit-1_{k}.jpg") for k in range(SHOTS)],
            ["0 photos of the view 'fit-1'; fit-1_0.jpg is not called", "fit-1_0.png"],
        ),
        (
            lambda copy: shutil.copy(copy / "before/fit-1_0.png", copy / "before/fit-1_2.png"),
            ["fit-1_2.png", "the same picture as fit-1_0.png", "noise"],
        ),
        (roughen_depths, ["before, fit", "only 0.0 % of the pixels can be compared", "Smooth"]),
        (lambda copy: read_poses_as(copy, lambda pose: FLIP @ pose), ["views.json", "do not fit each other", "OpenGL's axes"]),
        (lambda copy: read_poses_as(copy, np.linalg.inv), ["views.json", "they seem to be world_from_cam ("]),
        (
            lambda copy: read_poses_as(copy, lambda pose: np.linalg.inv(FLIP @ pose)),
            ["views.json", "they seem to be world_from_cam, with OpenGL's axes"],
        ),
        (lambda copy: read_poses_as(copy, in_millimetres), ["views.json", "their translations seem to be in millimetres"]),
        (lambda copy: write_depths(copy, lambda depths: 1e3 * depths), ["views.json", "the depths seem to be in millimetres"]),
        (lambda copy: read_poses_as(copy, lambda pose: np.eye(4)), ["views.json", "all views have one and the same pose"]),
        (lambda copy: (copy / "after/select-1_0.png").unlink(), ["select-1_0.png", "does not exist"]),
        (lambda copy: (copy / "before/select-1_2.png").unlink(), ["before", "some views have 2 photos, others 3"]),
        (lambda copy: [(copy / f"before/fit-1_{k}.png").unlink() for k in (1, 2)], ["1 photos of the view 'fit-1'"]),
        (lambda copy: write_image(copy / "after/fit-0_0.png", np.zeros((24, 32, 3))), ["fit-0_0.png", "32 x 24", "64 x 48"]),
        (lambda copy: np.savez(copy / "views/depths.npz", depths=np.ones((2, 48, 64))), ["depths.npz", "2 x 48 x 64"]),
        (lambda copy: np.savez(copy / "views/depths.npz", depth=np.ones(2)), ["depths.npz", "no depths"]),
        (lambda copy: (copy / "views/depths.npz").unlink(), ["depths.npz", "cannot be read"]),
        (lambda copy: (copy / "views/depths.npz").write_bytes(b""), ["depths.npz", "no depths"]),
        (lambda copy: np.savez(copy / "views/depths.npz", depths=np.zeros((15, 48, 64))), ["depths.npz", "no depth at any"]),
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
    write_picture_report("darker", *files[:3])
    page = files[2].read_text()
    assert found["sentence"][:20] in page
    assert page.count("data:image/png;base64,") == 1
    if BROWSER is not None:
        assert check(page, tmp_path)["sentence"] < 400
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
    write_picture_report("same", *files[:3])
    assert "agree" in files[2].read_text()
    with pytest.raises(StageError, match="named nothing"):
        amend_camera("models/nominal.yaml", files[0], files[3])
    # The photos of one day, as a reference, must not differ; a finding there stops the amendment.
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


def write_case(folder, **changes):
    """A case of these photos, next to them."""
    model = Path("models/nominal.yaml").resolve()
    content = {"model": str(model), "photos": {"views": "views", "before": "before", "after": "after"}, "effects": [*NAMES]}
    (folder / "photos.yaml").write_text(yaml.safe_dump({**content, **changes}))
    return folder / "photos.yaml"


@pytest.fixture(scope="module")
def stages(folder, tmp_path_factory):
    """All files of a case of pictures that went through the stages, its page and its recording too."""
    case, out = write_case(folder), tmp_path_factory.mktemp("stages")
    names = ("records", "comparison", "screen", "findings", "replays")
    paths = {name: out / f"{name}.json" for name in names} | {"data": out / "records.npz", "series": out / "replays.npz"}
    paths |= {"case": case, "model": Path("models/nominal.yaml").resolve(), "amended": out / "model.yaml"}
    paths |= {"page": out / "report.html", "recording": out / "case.rrd", "bank": out / "bank"}
    first = (paths["model"], paths["data"], paths["records"])
    write_case_records(case, paths["data"], paths["records"])
    write_comparison(*first, paths["comparison"])
    write_screening(*first, paths["bank"], paths["screen"])
    write_findings(*first, paths["bank"], paths["findings"], paths["amended"], 0)
    write_replays(*first, paths["findings"], paths["series"], paths["replays"])
    files = CaseFiles(*(paths[name] for name in ("records", "comparison", "screen", "findings", "series", "replays")))
    write_gap_report("darker", files, paths["page"])
    record_gap(paths["model"], paths["findings"], paths["series"], paths["replays"], "darker", paths["recording"])
    return paths


def test_a_case_of_pictures_goes_through_the_stages_as_logs_do(stages, folder, tmp_path):
    about, found = read_json(stages["records"]), read_json(stages["findings"])
    assert about["mode"] == "photos"
    assert about["records"]["fit"]["views"] == 5
    assert found["verdict"] == "named", found["sentence"]
    assert found["records"] == {role: item["digest"] for role, item in about["records"].items()}
    # The stages find the same as the function for photos without a case; only the time taken differs.
    write_image_findings(*parts(folder), tmp_path / "findings.json", tmp_path / "pictures.npz", seed=0, names=NAMES)
    direct = read_json(tmp_path / "findings.json")
    assert {**found, "seconds": 0} == {**direct, "seconds": 0}
    with np.load(tmp_path / "pictures.npz") as wanted, np.load(stages["series"]) as series:
        for name in wanted.files:
            np.testing.assert_array_equal(series[name], wanted[name], err_msg=name)
    effects = read_model(stages["amended"]).effects
    assert [effect.name for effect in effects] == ["exposure"]
    rows = read_json(stages["replays"])["records"]["verify"]
    assert rows["before"] == pytest.approx(found["verify"]["before"])
    assert rows["after"] == pytest.approx(found["verify"]["after"])
    assert rows["after"] < 0.5 * rows["before"]
    assert found["sentence"][:20] in stages["page"].read_text()
    assert gap_row("darker", found)["amended"] == "exposure"
    recorded = {path.strip("/") for path in read_recording(stages["recording"])}
    assert {"photos/before", "photos/after", "photos/expected", "apart/gap", "apart/left", "summary"} <= recorded


def test_the_map_of_pictures_agrees_with_residuals_taken_by_hand(stages, folder):
    """A third of the image by slices, and cells of a brightness by its rank, of one role."""
    pairs = read_pairs(*parts(folder))
    view = ImageResiduals(pairs["select"], learn_noise(list(pairs.values())))
    found = read_json(stages["comparison"])["records"]["select"]["residual_map"]
    columns = [name for names in found["groups"].values() for name in names]
    values = np.array(found["values"], dtype=float)
    pictures, mask = view.pictures(view.residual()).astype(float), view.mask > 0
    width = mask.shape[2]
    left = np.zeros_like(mask)
    left[:, :, : -(-width // 3)] = True
    wanted = np.sqrt((pictures[mask & left] ** 2).mean(axis=0))
    np.testing.assert_allclose(values[:, columns.index("left")], wanted, rtol=1e-6)
    dark, medium, bright = (values[:, columns.index(name)] for name in ("dark", "medium", "bright"))
    whole = np.sqrt((pictures[mask] ** 2).mean(axis=0))
    # Thirds of all pixels, so that their squares make those of the whole.
    np.testing.assert_allclose((dark**2 + medium**2 + bright**2) / 3, whole**2, rtol=0.03)
    assert np.array(found["marked"]).any()


def test_what_photos_can_tell_is_said_before_any_fit(stages, folder):
    """Cosines of two effects by hand, from pictures drawn with each of them at its typical size."""
    said = read_json(stages["screen"])
    assert sorted(said["candidates"]) == sorted(NAMES)
    assert said["signatures"] >= len(NAMES)
    pairs = read_pairs(*parts(folder))
    view = ImageResiduals(pairs["fit"], learn_noise(list(pairs.values())))
    changes = []
    for name in ("exposure", "black_level"):
        (parameter,) = IMAGE_EFFECTS[name].parameters
        applied = Applied(name, "", {parameter.name: parameter.typical})
        changes.append((view.residual() - view.residual([applied])).ravel().astype(float))
    cosine = abs(changes[0] @ changes[1]) / np.linalg.norm(changes[0]) / np.linalg.norm(changes[1])
    found = {tuple(sorted(item["pair"])): item["cosine"] for item in said["signature_similarity"]}
    assert found["black_level", "exposure"] == pytest.approx(cosine, rel=1e-3)
    assert all(value >= 0.95 for value in found.values())


def test_stored_photos_come_back_as_they_were(stages, folder):
    loaded = load_backend(stages["model"], stages["data"], stages["records"])
    for role, part in read_pairs(*parts(folder)).items():
        other = loaded.case.pairs[role]
        assert (other.camera, other.repeats, other.name, other.digest) == (part.camera, part.repeats, part.name, part.digest)
        for name in ("before", "again", "after", "depths", "poses"):
            np.testing.assert_array_equal(getattr(other, name), getattr(part, name))
    damaged = stages["data"].parent / "damaged.npz"
    damaged.write_bytes(stages["data"].read_bytes()[:5000])
    with pytest.raises(InputError, match="stored photos cannot be read"):
        load_backend(stages["model"], damaged, stages["records"])


def test_the_workflow_watches_all_photos_of_a_case(folder):
    watched = {path.resolve() for path in case_files(write_case(folder))}
    assert {path.resolve() for path in folder.rglob("*.png")} <= watched
    assert (folder / "views/depths.npz").resolve() in watched
    assert Path("models/nominal.yaml").resolve() in watched


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"photos": {"views": "views", "before": "before"}}, "'photos.after' names no folder"),
        ({"photos": {"views": "views", "before": "before", "after": "after", "days": 2}}, "the key 'photos.days' is unknown"),
        ({"photos": {"views": "views", "before": "before", "after": "after", "shot": -1}}, "'photos.shot' is -1"),
        ({"records": {"fit": "log.csv"}}, "the key 'records' is unknown"),
        ({"effects": ["coulomb"]}, "the effect 'coulomb' is unknown"),
        ({"photos": "after"}, "'photos' does not name a file for each role"),
        ({"model": "lost.yaml"}, "the model file cannot be read"),
    ],
)
def test_a_case_of_pictures_that_cannot_be_used_says_why(folder, changes, said):
    case = write_case(folder, **changes)
    with pytest.raises(InputError, match=re.escape(said)):
        read_backend(case)


def test_what_a_simulation_cannot_play_stays_out_of_the_model_of_a_case(stages, tmp_path):
    """The page says what to do instead; the diagnosis is no worse for it."""
    found = read_json(stages["findings"])
    found["amended"] = [*found["amended"], {"name": "latency", "parameters": {"delay": 0.1}}]
    backend = load_backend(stages["model"], stages["data"], stages["records"])
    backend.amend(stages["model"], found, tmp_path / "model.yaml")
    assert [effect.name for effect in read_model(tmp_path / "model.yaml").effects] == ["exposure"]
    assert "# not held: latency" in (tmp_path / "model.yaml").read_text()
