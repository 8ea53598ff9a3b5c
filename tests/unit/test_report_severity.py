"""Success against severity: which trials are asked for, and the table that is made of them."""

import csv
from pathlib import Path

import pytest
import yaml

from gsbridge.configuration.whole import read_configuration
from gsbridge.errors import InputError
from gsbridge.experiment.plan import Experiment
from gsbridge.experiment.severity_study import SeverityStudy
from gsbridge.files import write_json
from gsbridge.report.tables.severity import COLUMNS, write_severity
from gsbridge.statistics import wilson_interval

ROOT = Path(__file__).resolve().parents[2]


def study(worlds):
    config = yaml.safe_load((ROOT / "config.yaml").read_text())
    config["worlds"] |= worlds
    config["study"]["severity"] |= {
        "worlds": list(worlds), "renderers": ["gs", "mesh_shaded"], "variants": ["no_jitter"], "seeds": 2, "graded": ["default"]
    }  # fmt: skip
    return SeverityStudy(Experiment(read_configuration(config), ROOT, ROOT))


def test_every_one_is_tried_in_every_world():
    found = study({"fair": {"severity": 0}, "dim": {"severity": {"look": 3, "physics": 1}, "seed": 11}})
    assert [(row["file"], row["seed"], row["look"], row["physics"]) for row in found.controller] == [
        ("results/trials/grasp/small_cube+foam_pad/fair.json", 1, 0, 0),
        ("results/trials/grasp/small_cube+foam_pad/dim.json", 11, 3, 1),
    ]
    assert found.levels == {"fair": (0, 0), "dim": (3, 1)}
    trials = found.trials("worth", "csv")
    # Three cells, two renderers, two trainings, two worlds.
    assert len(trials) == len(set(trials)) == 3 * 2 * 2 * 2
    assert trials[7] == "results/trials/grasp/small_cube+foam_pad/mesh_shaded/no_jitter/dim/seed2.csv"
    assert len(found.trainings("worth")) == 3 * 2 * 2
    # Graded policies also in simulation, which is to foretell the rest.
    assert [path.split("/")[6] for path in found.trials("graded", "csv")] == ["sim", "fair", "dim"]


def test_the_policies_of_the_tables_are_tried_on_worse_days_whatever_they_are_called():
    worlds = {"fair": 0, "shed": 2, "yard": {"look": 3, "physics": 3}, "dim": {"look": 2, "physics": 3}, "storm": 4}
    found = study({name: {"severity": severity} for name, severity in worlds.items()})
    assert found.judged == ["shed", "yard"]
    cells = found.plan.config["cells"]
    trials = found.trials("severity", "csv")
    # Each once in simulation and on both days.
    assert len(trials) == len(set(trials)) == 3 * len(cells)
    assert trials[:3] == [
        f"results/trials/grasp/small_cube+foam_pad/gs/default/{world}/seed1.csv" for world in ("sim", "shed", "yard")
    ]
    assert "results/trials/grasp/bear+foam_pad/mesh/default/yard/seed1.csv" in trials
    assert "results/trials/pick_and_place/cake+plate/gs/default/shed/seed1.csv" in trials
    assert len(found.trainings("severity")) == len(cells)
    assert [found.compares(who) for who in ("severity", "worth", "graded")] == [True] * 3
    assert [study({"fair": {"severity": 0}}).compares(who) for who in ("severity", "worth", "graded")] == [False, True, True]
    assert not any(study({}).compares(who) for who in ("severity", "worth", "graded"))


def test_rows_and_table_say_what_the_trials_say(tmp_path):
    trials = [
        {"success_tolerant": k < 5, "failure": "" if k < 5 else "dropped" if k < 7 else "time_out", "steps": 30 + k}
        for k in range(8)
    ]
    write_json(tmp_path / "lab_1.json", {"trials": trials})
    source = {
        "file": tmp_path / "lab_1.json", "who": "controller", "task": "grasp", "object": "small_cube",
        "background": "foam_pad", "world": "lab_1", "seed": 11, "look": 1, "physics": 1,
    }  # fmt: skip
    write_severity(tmp_path / "rows.csv", tmp_path / "page.md", [source])
    with open(tmp_path / "rows.csv", newline="") as file:
        (row,) = csv.DictReader(file)
    assert tuple(row) == COLUMNS
    low, high = wilson_interval(5, 8)
    wanted = ("8", "5", "0.6250", f"{low:.4f}", f"{high:.4f}", "33.5000", "dropped 2, time_out 1")
    assert tuple(row[key] for key in ("trials", "success", "rate", "low", "high", "steps", "failures")) == wanted
    page = (tmp_path / "page.md").read_text()
    assert "| who | lab_1: look 1, physics 1 |" in page
    assert "| controller | 5/8" in page
    documented = (ROOT / "docs/mirror.md").read_text().split("### Success against severity")[1]
    assert all(f"`{name}`" in documented for name in COLUMNS)


@pytest.mark.parametrize(
    ("content", "words"), [({"trials": [{"failure": ""}]}, "damaged"), ({"trials": []}, "no trials"), ({}, "damaged")]
)
def test_damaged_records_are_named(tmp_path, content, words):
    write_json(tmp_path / "lab.json", content)
    source = {"file": tmp_path / "lab.json", "who": "controller", "world": "lab", "seed": 1, "look": 0, "physics": 0}
    with pytest.raises(InputError, match=words):
        write_severity(tmp_path / "rows.csv", tmp_path / "page.md", [source])
    with pytest.raises(InputError, match=r"study.severity.worlds"):
        write_severity(tmp_path / "rows.csv", tmp_path / "page.md", [])
