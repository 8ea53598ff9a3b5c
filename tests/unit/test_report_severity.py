"""Success against severity: which trials are asked for, and the table that is made of them."""

import csv
from pathlib import Path

import pytest
import yaml
from policy_files import trial_rows

from gsbridge.configuration.whole import read_configuration
from gsbridge.errors import InputError
from gsbridge.experiment.plan import Experiment
from gsbridge.experiment.severity_study import SeverityStudy
from gsbridge.files import write_json
from gsbridge.report.tables.rows import write_rows
from gsbridge.report.tables.severity import COLUMNS, write_severity
from gsbridge.report.tables.success_rows import TRIAL_COLUMNS
from gsbridge.statistics import wilson_interval

ROOT = Path(__file__).resolve().parents[2]


def study(worlds):
    config = yaml.safe_load((ROOT / "config.yaml").read_text())
    config["worlds"] |= worlds
    config["study"]["severity"] |= {"worlds": list(worlds), "renderers": ["gs", "mesh"], "variants": ["no_jitter"]}
    return SeverityStudy(Experiment(read_configuration(config), ROOT, ROOT), [1, 2])


def test_every_one_is_tried_in_every_world():
    found = study({"fair": {"severity": 0}, "dim": {"severity": {"look": 3, "physics": 1}, "seed": 11}})
    controller = found.sources("controller")
    assert found.files("controller") == [f"results/trials/grasp/small_cube+foam_pad/{name}.json" for name in ("fair", "dim")]
    assert [(row["seed"], row["look"], row["physics"]) for row in controller] == [(1, 0, 0), (11, 3, 1)]
    policies = found.sources("policies")
    assert len(policies) == 2 * 1 * 2 * 2
    assert policies[-1]["file"] == "results/trials/grasp/small_cube+foam_pad/mesh/no_jitter/dim/seed2.csv"
    assert {(row["renderer"], row["training"]) for row in policies} == {(r, s) for r in ("gs", "mesh") for s in (1, 2)}


def test_rows_and_table_say_what_the_trials_say(tmp_path):
    where = {"task": "grasp", "object": "small_cube", "background": "foam_pad"}
    trials = [
        {"success_tolerant": k < 5, "failure": "" if k < 5 else "dropped" if k < 7 else "time_out", "steps": 30 + k}
        for k in range(8)
    ]
    write_json(tmp_path / "lab_1.json", {"trials": trials})
    write_rows(tmp_path / "lab_2.csv", TRIAL_COLUMNS, trial_rows({"fixed": 12, "unseen": 20}, forgiven=3))
    sources = [
        {"file": tmp_path / "lab_1.json", "who": "controller", **where, "world": "lab_1", "seed": 11, "look": 1, "physics": 1},
        {
            "file": tmp_path / "lab_2.csv", "who": "policy", "renderer": "gs", "variant": "default", "training": 1, **where,
            "world": "lab_2", "seed": 11, "look": 2, "physics": 2,
        },
    ]  # fmt: skip
    write_severity(tmp_path / "rows.csv", tmp_path / "page.md", sources)
    with open(tmp_path / "rows.csv", newline="") as file:
        first, second = csv.DictReader(file)
    assert tuple(first) == COLUMNS
    low, high = wilson_interval(5, 8)
    wanted = ("8", "5", "0.6250", f"{low:.4f}", f"{high:.4f}", "33.5000", "dropped 2, time_out 1", "")
    assert tuple(first[key] for key in ("trials", "success", "rate", "low", "high", "steps", "failures", "renderer")) == wanted
    # Excess contact is forgiven, three times in each set.
    assert (second["trials"], second["success"], second["failures"]) == ("64", "38", "not_grasped 26")
    page = (tmp_path / "page.md").read_text()
    assert "| who | lab_1: look 1, physics 1 | lab_2: look 2, physics 2 |" in page
    assert "| policy gs default 1 |  | 38/64" in page
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
