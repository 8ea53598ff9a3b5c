"""Figures of the simulator from records that are written here."""

import numpy as np
import pytest
from test_report_score import FLOORS

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.report.figures.eye_in_hand import COLUMNS, COMPARED
from gsbridge.report.scores.measured_scenes import (
    environment_figures,
    eye_in_hand_figures,
    trial_figures,
    write_simulator_figures,
)
from gsbridge.report.scores.registration import score_registration
from gsbridge.report.scores.score import read_floors
from gsbridge.report.tables.rows import write_rows


def record(task="grasp", strict=(32, 31, 32), tolerant=(32, 32, 32), poses=32):
    seeds = [str(k) for k in range(len(strict))]
    counts = {"success": dict(zip(seeds, strict, strict=True)), "success_tolerant": dict(zip(seeds, tolerant, strict=True))}
    return {"task": task, "poses": poses, "seeds": list(range(len(strict))), "counts": counts}


def test_the_worst_set_counts_and_excess_contact_only_in_simulation():
    good = (32, 32, 32)
    found = [("cube+pad", record()), ("cube+cloth", record(strict=good)), ("bear+pad", record(strict=good))]
    found.append(("cake+plate", record("pick_and_place")))
    sim, mirror = trial_figures(found, "sim"), trial_figures(found, "mirror")
    assert sim["controller_grasp_sim"]["value"] == 31
    assert sim["controller_grasp_sim"]["by_scene"] == {"cube+pad": 31, "cube+cloth": 32, "bear+pad": 32}
    assert (sim["controller_grasp_sim"]["n"], sim["controller_grasp_sim"]["seeds"]) == (3, 3)
    assert sim["controller_place_sim"]["value"] == 31
    assert mirror["controller_grasp_mirror"]["value"] == mirror["controller_place_mirror"]["value"] == 32
    assert trial_figures([("cube+pad", record(poses=8))], "sim") == {}


def test_lead_is_over_the_better_control():
    rows = [
        {"object": "cube", "background": "pad", "renderer": name, "views": "32", "psnr": str(value)}
        for name, value in (("gs", 27.0), ("gs_unshaded", 25.5), ("mesh", 24.0), ("mesh_vertex", 22.5), ("mesh_shaded", 24.5),
                            ("mesh_vertex_shaded", 25.0))
    ]  # fmt: skip
    found = eye_in_hand_figures(rows)
    assert found["eye_in_hand_gs_min"]["value"] == 27.0
    assert found["eye_in_hand_lead_min"]["value"] == pytest.approx(3.0)
    assert found["eye_in_hand_lead_min"]["views"] == 32
    assert found["eye_in_hand_lead_unshaded_min"]["value"] == pytest.approx(1.5)
    assert found["eye_in_hand_lead_shaded_min"]["value"] == pytest.approx(2.0)
    assert eye_in_hand_figures([]) == {}


def test_speed_counts_cpu_time_and_parts_that_did_not_run_are_left_out():
    found = environment_figures({"gs_128": {"steps_per_second": 160.0, "rounds": 8, "slowest_round_ms": 8.0, "steps": 90}})
    assert set(found) == {"environment_steps_128"}
    assert found["environment_steps_128"]["value"] == 160.0
    assert found["environment_steps_128"]["interval"] == [125.0, 160.0]
    assert found["environment_steps_128"]["interval_of"] == "slowest and fastest of 8 rounds"


def test_registration_is_compared_with_the_truth(tmp_path):
    pose, moved = np.eye(4), np.eye(4)
    moved[:3, 3] = (0.003, 0.0, 0.004)
    write_json(tmp_path / "found.json", {"base_from_table": moved, "flange_from_camera": pose, "reasons": []})
    write_json(tmp_path / "truth.json", {"base_from_table": pose, "flange_from_camera": pose})
    score_registration(tmp_path / "found.json", tmp_path / "truth.json", tmp_path / "out.json")
    out = read_json(tmp_path / "out.json")
    assert out["base_from_table"] == {"mm": pytest.approx(5.0), "deg": pytest.approx(0.0, abs=1e-6)}
    write_json(tmp_path / "truth.json", {"base_from_table": pose})
    with pytest.raises(InputError, match="truth is damaged"):
        score_registration(tmp_path / "found.json", tmp_path / "truth.json", tmp_path / "out.json")


def files(tmp_path):
    """One of each file that the area is made of."""
    trials = tmp_path / "trials" / "grasp" / "cube+pad"
    made = {
        "asset": (tmp_path / "cube" / "asset" / "asset.json", {
            "rest": {"penetration_mm": 0.1, "drift_mm": 0.2, "drift_deg": 0.3}, "photos": {"psnr": 30.0, "stage_psnr": 30.01}}),
        "sim": (trials / "sim.json", record()),
        "mirror": (trials / "mirror.json", record()),
        "checks": (tmp_path / "simulator.json", {"twin": {"tool_mm": 0.4}, "repeated": {"identical": True, "repetitions": 4}}),
        "views": (tmp_path / "cube+pad" / "drawn.json", {"views": 32, "coverage": {"min": 0.999, "mean": 1.0}}),
        "registration": (tmp_path / "registration.json", {
            name: {"mm": 0.1, "deg": 0.01} for name in ("base_from_table", "flange_from_camera")}),
        "environment": (tmp_path / "environment.json", {
            **{f"gs_{size}": {
                "steps_per_second": 200.0, "slowest_round_ms": 6.0, "rounds": 8, "steps": 5} for size in (128, 64)},
            **{name: {"seconds_min": 0.1, "seconds_median": 0.12, "pictures": 20}
               for name in ("mirror_64", "mirror_64_severity_2")}}),
    }  # fmt: skip
    for path, content in made.values():
        write_json(path, content)
    rows = [
        {"object": "cube", "background": "pad", "renderer": name, "views": 32, "psnr": 25.0, "psnr_min": 1.0, "psnr_max": 2.0}
        for name in COMPARED
    ]
    write_rows(tmp_path / "rows.csv", COLUMNS, rows)
    paths = {name: path for name, (path, _) in made.items()}
    lists = {"assets": [paths.pop("asset")], **{name: [paths.pop(name)] for name in ("sim", "mirror", "views")}}
    return {**paths, **lists, "eye_in_hand": tmp_path / "rows.csv"}


def test_every_floor_of_the_area_has_its_figure(tmp_path):
    write_simulator_figures(tmp_path / "out.json", **files(tmp_path), preset="desktop")
    found = read_json(tmp_path / "out.json")["figures"]
    wanted = {name for name, entry in read_floors(FLOORS).items() if entry["area"] == "simulator"}
    # Placing was not tried here.
    assert wanted - set(found) == {"controller_place_sim", "controller_place_mirror"}
    assert set(found) <= wanted
    assert found["asset_psnr_loss_max"]["value"] == pytest.approx(0.01)


def test_damaged_records_are_named(tmp_path):
    given = files(tmp_path)
    write_json(given["checks"], {"twin": {}})
    with pytest.raises(InputError, match="simulator is damaged"):
        write_simulator_figures(tmp_path / "out.json", **given)
