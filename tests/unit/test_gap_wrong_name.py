"""Controls of the closed loops: amendments of equal size under a wrong name, and what variants change beside their model."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy import stats

from gsbridge.cameras import Camera
from gsbridge.effects.registry import Applied
from gsbridge.errors import StageError
from gsbridge.experiment.policies import workspace_of
from gsbridge.files import write_json
from gsbridge.gap.image.model import image_candidates
from gsbridge.gap.loop.wrong_name import amend_camera_wrongly, wrong_effect
from gsbridge.images import write_image
from gsbridge.policy.augment import Augmentation
from gsbridge.report.figures.loop import worth
from gsbridge.sim.model import read_model
from gsbridge.tasks.views import ROLES

NAMED = [Applied("exposure", "", {"stops": 0.4})]


def linear(effects):
    """A residual that answers each effect by a direction of its own, in proportion."""
    out = np.zeros((20, 3))
    for effect in effects:
        rng = np.random.default_rng(sum(map(ord, effect.name)))
        for value in effect.parameters.values():
            out += value * rng.normal(size=out.shape)
    return out


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_wrong_name_changes_as_much_as_the_named_effect(seed):
    wrong = wrong_effect(linear, NAMED, image_candidates(), seed)
    assert wrong.name != "exposure"
    ratio = np.linalg.norm(linear((wrong,))) / np.linalg.norm(linear(NAMED))
    assert ratio == pytest.approx(1.0, abs=0.03)
    assert wrong == wrong_effect(linear, NAMED, image_candidates(), seed)


def test_without_another_effect_of_that_size_the_stage_stops():
    with pytest.raises(StageError, match="no other effect"):
        wrong_effect(linear, [Applied("exposure", "", {"stops": 1e9})], image_candidates(("exposure", "response")), 0)


def test_the_camera_gets_the_wrong_name_and_the_head_says_so(tmp_path):
    """Photos of a flat surface from places side by side, two pixels apart in the picture; the later ones are brighter."""
    camera, rng, views = Camera(64, 48, 60.0, 60.0, 32.0, 24.0), np.random.default_rng(0), []
    surface = np.clip(0.3 + 0.3 * rng.random((48, 64 + 22, 1)) * np.ones(3), 0.0, 1.0)
    for n in range(12):
        scene, pose = surface[:, 22 - 2 * n :][:, :64], np.eye(4)
        pose[:3, 3] = [2 * n * 0.4 / camera.fx, 0.0, 0.0]
        views.append({"name": f"{n}", "role": ROLES[n % 3], "cam_from_world": pose.tolist()})
        for k in range(2):
            write_image(tmp_path / "before" / f"{n}_{k}.png", np.clip(scene + 0.004 * rng.normal(size=scene.shape), 0, 1))
        write_image(tmp_path / "after" / f"{n}_0.png", np.clip(1.1 * scene, 0, 1))
    (tmp_path / "views").mkdir()
    write_json(tmp_path / "views/views.json", {"camera": camera.to_json(), "views": views})
    np.savez(tmp_path / "views/depths.npz", depths=np.full((12, 48, 64), 0.4, np.float32))
    amended = [{"name": "exposure", "parameters": {"stops": 0.25}}]
    write_json(tmp_path / "findings.json", {"amended": amended, "verdict": "named", "seed": 1})
    photos = tuple(tmp_path / name for name in ("views", "before", "after"))
    amend_camera_wrongly("models/nominal.yaml", photos, tmp_path / "findings.json", tmp_path / "model.yaml", 3)
    (effect,) = read_model(tmp_path / "model.yaml").effects
    assert effect.name != "exposure"
    assert "which was named" in (tmp_path / "model.yaml").read_text()
    write_json(tmp_path / "findings.json", {"amended": [], "verdict": "ambiguous", "seed": 1})
    with pytest.raises(StageError, match="nothing was named"):
        amend_camera_wrongly("models/nominal.yaml", photos, tmp_path / "findings.json", tmp_path / "model.yaml", 3)


def test_a_work_place_that_was_registered_anew_brings_its_robot_and_colours():
    plain = {"registered_in": None, "calibrated_in": None}
    assert workspace_of(plain)["registration"] == "results/workspace/registration.json"
    moved = workspace_of(plain | {"registered_in": "lab"})
    assert set(moved.values()) == {
        f"results/workspace/worlds/lab/{name}" for name in ("registration.json", "description", "photometry.json", "splats")
    }
    tinted = workspace_of(plain | {"calibrated_in": "lab"})
    assert (tinted["registration"], tinted["robot"]) == ("results/workspace/registration.json", "results/robot/description")
    assert tinted["photometry"] == "results/workspace/worlds/lab/photometry.json"


def test_wider_jitter_widens_pictures_and_nothing_that_the_hand_feels():
    wide, plain = Augmentation().widened(2.0), Augmentation()
    assert (wide.jitter.brightness, wide.offset, wide.noise) == (0.8, 0.08, 0.06)
    assert wide.opening == plain.opening
    assert plain.widened(1.0) == plain


def row(variant, each):
    good = [int(part) for part in each.split()]
    tried = 32 * len(good)
    rate = sum(good) / tried
    return {
        "variant": variant, "world": "late", "trials": tried, "successes": sum(good), "success_rate": rate,
        "trainings": len(good), "successes_each": each,
    }  # fmt: skip


def test_what_a_diagnosis_is_worth_is_told_beyond_its_best_control():
    rows = [row("amended", "32 30 31"), row("wrong_name", "4 9 2"), row("wider", "20 28 12")]
    said = worth(rows, {"world": "late", "variant": "amended", "controls": ["wrong_name", "wider"]})
    assert "93 of 96" in said
    assert "60 of 96" in said
    assert "best of 2 controls (wider, trainings: 3)" in said
    assert "+34 points" in said
    low, high = (int(part) for part in said.split("95 %: ")[1].rstrip(").").split(" to "))
    # Three trainings that differ this much say little: Welch's interval is far wider than one from counted trials.
    welch = stats.ttest_ind(np.array([32, 30, 31]) / 32, np.array([20, 28, 12]) / 32, equal_var=False).confidence_interval()
    assert (low, high) == (round(100 * welch.low), round(100 * welch.high))
    assert low < 20 < 50 < high
    assert "no control was trained" in worth(rows, {"world": "late", "variant": "amended", "controls": []})


def test_the_configured_controls_differ_from_their_variant_in_one_thing():
    config = yaml.safe_load(Path("config.yaml").read_text(encoding="utf-8"))
    pictures, variants = config["study"]["picture_gap"], config["variants"]
    for world, names in pictures["controls"].items():
        (mine,) = pictures["amended"][world]
        for name in names:
            given = variants[name]
            if name != "wider_jitter":
                assert given.get("policy") == variants[mine].get("policy"), name
    assert set(config["loop"]["controls"]) >= {"wider_jitter", "wrong_name", "unchanged_teacher"}
