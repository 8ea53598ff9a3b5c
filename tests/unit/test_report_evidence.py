"""What is kept of the rows, that it tells the recorded figures again without the library, and what README may quote."""

import gzip
import importlib.util
import json
import re
import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from policy_files import trial_rows, write_trials

from gsbridge.errors import InputError
from gsbridge.files import write_json
from gsbridge.report.scores import evidence
from gsbridge.report.scores.evidence import flattened, write_evidence, write_packed, write_timings
from gsbridge.report.scores.measured_policies import success_figures
from gsbridge.report.scores.measured_severity import graded_figures, severity_figures, worth_figures
from gsbridge.report.scores.readme_block import BEGIN, END, HEADLINES, readme_block, with_block
from gsbridge.report.scores.results_page import shown_interval
from gsbridge.report.tables.paper import PAPER_GRASPS, PAPER_SUCCESS
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import read_rows, write_rows
from gsbridge.report.tables.severity_rows import write_severity_rows
from gsbridge.report.tables.success_rows import COLUMNS, TRIAL_COLUMNS, read_trial_files, success_rows

ROOT = Path(__file__).resolve().parents[2]


def recompute(folder, monkeypatch):
    """The program that recomputes, looking at another folder."""
    spec = importlib.util.spec_from_file_location("recompute", ROOT / "benchmarks/recompute.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "HERE", folder)
    return module


def test_it_needs_pandas_alone():
    text = (ROOT / "benchmarks/recompute.py").read_text()
    assert set(re.findall(r"(?m)^(?:import|from) (\w+)", text)) == {"json", "sys", "pathlib", "pandas"}


def test_records_become_entries_and_long_curves_are_left_out():
    record = {"a": {"b": [1, {"c": None}]}, "curve": list(range(500)), "cases": [{"k": 1}] * 70}
    found = dict(flattened(record))
    assert found["a.b.0"] == 1
    assert found["a.b.1.c"] is None
    assert not any(key.startswith("curve") for key in found)
    assert found["cases.69.k"] == 1


def test_equal_rows_are_equal_bytes(tmp_path):
    for name in ("one", "two"):
        write_packed(tmp_path / name, ("a", "b"), [{"a": "1"}, {"a": "2", "b": "x"}])
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    assert gzip.decompress((tmp_path / "one").read_bytes()) == b"a,b\n1,\n2,x\n"


def test_kinds_are_tables_and_too_much_is_refused(tmp_path, monkeypatch):
    write_rows(tmp_path / "a.csv", ("x",), [{"x": 1}])
    write_rows(tmp_path / "b.csv", ("x", "y"), [{"x": 2, "y": True}])
    write_json(tmp_path / "c.json", {"n": 0.1, "fine": True})
    csvs = [str(tmp_path / name) for name in ("a.csv", "b.csv")]
    write_evidence({"rows": csvs, "records": [tmp_path / "c.json"], "none": []}, tmp_path / "out/area")
    rows = pd.read_csv(tmp_path / "out/area/rows.csv.gz")
    assert rows.file.tolist() == csvs
    assert rows.x.tolist() == [1, 2]
    records = pd.read_csv(tmp_path / "out/area/records.csv.gz")
    assert dict(zip(records.key, records.value, strict=True)) == {"n": "0.1", "fine": "true"}
    assert not (tmp_path / "out/area/none.csv.gz").exists()
    with pytest.raises(InputError, match="mixed"):
        write_evidence({"all": [*csvs, tmp_path / "c.json"]}, tmp_path / "out/other")
    monkeypatch.setattr(evidence, "LARGEST_MB", 1e-4)
    with pytest.raises(InputError, match="Keep fewer"):
        write_evidence({"rows": csvs}, tmp_path / "out/third")


def trial_files(folder, rng):
    """Made-up trials of the paper's grasp cells, some with excess contact, in three worlds."""
    paths = []
    for cell in PAPER_GRASPS:
        for world in ("sim", "mirror"):
            for seed in (1, 2):
                place = f"{cell.task}/{cell.object}+{cell.background}/{cell.renderer}/{cell.variant}"
                name = f"results/trials/{place}/{world}/seed{seed}"
                tolerant = rng.random(64) < rng.uniform(0.5, 1)
                strict = tolerant & (rng.random(64) < 0.9)
                rows = [
                    {
                        **dict.fromkeys(TRIAL_COLUMNS, 0),
                        "pose_set": "fixed" if index < 32 else "unseen",
                        "index": index % 32,
                        "quadrant": "",
                        "success": bool(strict[index]),
                        "success_tolerant": bool(tolerant[index]),
                        "failure": "" if strict[index] else "time_out",
                    }
                    for index in range(64)
                ]
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                write_rows(folder / f"{name}.csv", TRIAL_COLUMNS, rows)
                write_json(folder / f"{name}.json", {"status": "pass", "reasons": []})
                paths.append(f"{name}.csv")
    return paths


def test_success_and_drops_are_told_again_from_the_trials(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    paths = trial_files(tmp_path, np.random.default_rng(0))
    write_evidence({"trials": paths}, tmp_path / "evidence/policies")
    write_rows(tmp_path / "rows.csv", COLUMNS, success_rows(read_trial_files(paths)))
    wanted = success_figures(read_rows(tmp_path / "rows.csv"), [], [])
    found = recompute(tmp_path, monkeypatch).success("policies")
    assert set(found) == set(wanted)
    for name, figure in wanted.items():
        assert found[name] == pytest.approx(figure["value"], abs=1e-2), name


def trials_of(folder, cell, world, seed, rng):
    """Made-up trials of a policy, some with excess contact, as a file below `results`."""
    sets = {"fixed": 32, "unseen": 32} | ({"outside": 16} if cell.task == "grasp" else {})
    rows = [
        one
        for name, count in sets.items()
        for one in trial_rows({name: int(rng.integers(count - 1))}, count=count, forgiven=2, failure="time_out")
    ]
    return str(write_trials(folder, cell, world, rows, seed=seed).relative_to(folder))


LABS = {"lab_1": (1, 1), "lab_2": (2, 2), "lab_3": (3, 3), "dim": (3, 1)}


def kept(folder, area, kinds):
    """Keep the trials of each kind as evidence of an area, with the rows that are made of them; returns these by kind."""
    made = {who: f"results/rows/{who}.csv" for who in kinds}
    (folder / "results/rows").mkdir(parents=True)
    for who, paths in kinds.items():
        write_severity_rows(made[who], paths, LABS)
    trials = {"trials" if who == "severity" else who: paths for who, paths in kinds.items()}
    write_evidence({**trials, "rows": list(made.values())}, folder / f"evidence/{area}")
    return {who: read_rows(path) for who, path in made.items()}


def test_success_at_severity_is_told_again_from_the_trials(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    paths = [trials_of(tmp_path, cell, world, 1, rng) for cell in PAPER_SUCCESS for world in ("sim", "lab_2", "lab_3", "dim")]
    wanted = severity_figures(kept(tmp_path, "severity", {"severity": paths})["severity"])
    found = recompute(tmp_path, monkeypatch).severity()
    assert {"severity_grasp_2", "severity_place_3", "severity_mesh_2", "severity_grasp_outside_3"} <= set(found)
    assert found == pytest.approx({name: figure["value"] for name, figure in wanted.items()})


def test_what_splats_are_worth_is_told_again_from_the_trials(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(2)
    places = (("grasp", "small_cube", "foam_pad"), ("grasp", "bear", "tablecloth"), ("pick_and_place", "cake", "plate"))
    drawn = product(places, ("gs", "gs_soft", "mesh_vertex_shaded", "mesh_shaded"), ("no_jitter", "default"))
    cells = [CellPaths(*place, renderer, variant) for place, renderer, variant in drawn]
    grades = [CellPaths(*places[0], variant=f"steps_{grade}") for grade in range(12)]
    kinds = {
        "worth": [trials_of(tmp_path, *one, rng) for one in product(cells, ("lab_1", "lab_2", "lab_3"), (1, 2))],
        "graded": [trials_of(tmp_path, *one, rng) for one in product(grades, ("sim", "lab_2", "lab_3"), (1,))],
    }
    rows = kept(tmp_path, "worth", kinds)
    wanted = {**worth_figures(rows["worth"]), **graded_figures(rows["graded"])}
    found = recompute(tmp_path, monkeypatch).worth()
    assert {"worth_lead_one_colour_no_jitter_2", "worth_lead_best_mesh_jitter_3"} <= set(found)
    assert {"graded_r_2", "graded_mmrv_2", "graded_spread"} <= set(found)
    assert found == pytest.approx({name: figure["value"] for name, figure in wanted.items()})


def test_a_smaller_study_is_told_again_too(tmp_path, monkeypatch):
    """Without graded policies, and without a mesh."""
    monkeypatch.chdir(tmp_path)
    cell = CellPaths("grasp", "bear", "foam_pad")
    kept(tmp_path, "worth", {"worth": [trials_of(tmp_path, cell, "lab_2", 1, np.random.default_rng(3))]})
    program = recompute(tmp_path, monkeypatch)
    assert set(program.worth()) == {"worth_splats_jitter_2", "worth_splats_jitter_outside_2"}
    assert program.severity() == {}


def test_names_and_alarms_are_told_again_from_the_cases(tmp_path, monkeypatch):
    cases = [
        {"kind": "single", "units": 5.0, "hidden": "latency", "outcome": "right"},
        {"kind": "single", "units": 5.0, "hidden": "latency", "outcome": "covered"},
        {"kind": "single", "units": 1.0, "hidden": "latency", "outcome": "wrong"},
        {"kind": "none", "units": 0.0, "hidden": "", "outcome": "false_alarm"},
        {"kind": "none", "units": 0.0, "hidden": "", "outcome": "right"},
    ]
    path = tmp_path / "results/gap-benchmark/t1/scores.json"
    write_json(path, {"methods": {"gsbridge": {"list": cases}, "other": {"list": cases[:1]}}})
    monkeypatch.chdir(tmp_path)
    write_evidence({"tiers": [str(path.relative_to(tmp_path))]}, tmp_path / "evidence/gap")
    assert recompute(tmp_path, monkeypatch).gap("gap") == {
        "gap_named_right_t1": 50.0,
        "gap_false_alarm_t1": 50.0,
        "gap_false_alarm": 50.0,
    }
    laws = [
        {"kind": "single", "right": ["coulomb:pan"], "outcome": "right"},
        {"kind": "single", "right": ["coulomb:pan"], "outcome": "mute"},
        {"kind": "pair", "right": ["coulomb:pan", "lag"], "outcome": "wrong"},
        {"kind": "mismatch", "right": ["lag"], "outcome": "right"},
        {"kind": "free", "right": [], "outcome": "quiet"},
        {"kind": "free", "right": [], "outcome": "quiet"},
    ]
    write_json(tmp_path / "results/benchmarks/gap_mismatch.json", {"cases": laws})
    both = {"tiers": [str(path.relative_to(tmp_path))], "mismatch": ["results/benchmarks/gap_mismatch.json"]}
    write_evidence(both, tmp_path / "evidence/gap")
    found = recompute(tmp_path, monkeypatch).gap("gap")
    assert found["gap_false_alarm"] == 25.0  # one of two cases, none of two more
    assert {name: found[name] for name in found if name.endswith("_t6")} == {
        "gap_named_right_t6": 50.0,
        "gap_wrong_t6": 25.0,
        "gap_false_alarm_t6": 0.0,
    }


def test_recorded_figures_are_those_of_the_evidence():
    found = subprocess.run([sys.executable, "benchmarks/recompute.py"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr


# README


def record(name, value, code):
    score = {
        "what": "a figure",
        "value": value,
        "unit": "dB",
        "floor": 1,
        "direction": "at_least",
        "met": value is not None and value >= 1,
    }
    score["interval"] = None if value is None else [value - 1, value + 1]
    return {"provenance": {"code": {"rule": code}, "settings": {}}, "figures": {name: score}}


def test_only_fresh_figures_are_quoted():
    records = {"real2sim": record(HEADLINES[0], 7.25, "a"), "gap": record(HEADLINES[1], 8.5, "old"), "study": {}}
    now = {area: {"code": {"rule": "a"}, "settings": {}} for area in records}
    block = readme_block(records, now)
    assert "| a figure | 7.25 dB | 6.25 … 8.25 | ≥ 1 dB | real2sim |" in block
    assert "8.5" not in block
    assert "missed" not in block
    assert "Measured on an earlier tree: gap." in block
    assert "Not measured yet: study." in block
    nothing = readme_block({"gap": records["gap"]}, now)
    assert nothing.startswith("No figure is quoted")
    assert not re.search(r"\d", nothing)


@pytest.mark.parametrize(
    ("value", "head", "told"),
    [
        (
            0.5,
            "Missed floors, 1 of the 2 in the areas that are measured on this tree:",
            "| a figure | 0.5 dB | -0.5 … 1.5 | ≥ 1 dB | gap |",
        ),
        (None, "Floors that nothing was measured against, 1 of the 2:", "* a figure: ≥ 1 dB (gap)"),
    ],
)
def test_every_missed_floor_is_told_whether_it_is_a_headline_or_not(value, head, told):
    good, bad = record(HEADLINES[0], 7.25, "a"), record("no_headline", value, "a")
    block = readme_block(
        {"real2sim": good, "gap": bad}, {area: {"code": {"rule": "a"}, "settings": {}} for area in ("real2sim", "gap")}
    )
    assert told in block.partition(head)[2]
    assert block.count("1 of the 2") == 1


def test_a_mean_of_two_shows_both_values():
    """Student's interval of two values is wider than anything possible."""
    score = {"interval": [-226.6, 265.3], "interval_of": "95 % of the mean over scenes (Student)"}
    assert shown_interval({**score, "by_scene": {"a": 38.7096, "b": -0.0}}) == "38.71 and 0 (both)"
    assert shown_interval({**score, "by_scene": {"a": 1.0, "b": 2.0, "c": 3.0}}) == "-226.6 … 265.3"
    assert shown_interval({"interval": [1.0, 2.0], "interval_of": "range over scenes", "by_scene": {"a": 1, "b": 2}}) == "1 … 2"
    assert shown_interval({"interval": None}) == "–"


def test_the_block_is_replaced_and_nothing_else():
    page = f"above\n{BEGIN}\nold\n{END}\nbelow"
    assert with_block(page, "new") == f"above\n{BEGIN}\n\nnew\n\n{END}\nbelow"
    with pytest.raises(ValueError, match="once"):
        with_block("nothing here", "new")


def test_headlines_are_figures_with_floors():
    import yaml

    assert set(HEADLINES) <= set(yaml.safe_load((ROOT / "benchmarks/floors.yaml").read_text()))


ALLOWED = {"100 %", "5 %", "5 GB"}
"""Scale of a printer, the error of a length given by hand, and the disk that an environment takes."""


def test_readme_quotes_figures_in_its_block_alone():
    """A figure elsewhere would go stale unseen; after a change of code or settings `make results-page` writes the block."""
    found = subprocess.run(
        [sys.executable, "-m", "benchmarks.readme", "--check"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    page = re.sub(f"{re.escape(BEGIN)}.*?{re.escape(END)}", "", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    quoted = set(re.findall(r"\d+(?:\.\d+)? ?(?:dB|%|hours?|minutes?|ms|mm|GB|MB|seconds?|fps)(?!\w)", page))
    assert quoted <= ALLOWED


def test_json_of_records_is_kept_to_the_last_digit(tmp_path):
    write_json(tmp_path / "a.json", {"x": 0.1 + 0.2})
    write_evidence({"a": [tmp_path / "a.json"]}, tmp_path / "out/a")
    kept = pd.read_csv(tmp_path / "out/a/a.csv.gz", dtype=str).value[0]
    assert float(kept) == json.loads((tmp_path / "a.json").read_text())["x"]


def test_times_of_rules_are_compared_over_the_jobs_that_both_runs_have(tmp_path):
    for run, seconds in (("before", 4.0), ("after", 1.0)):
        for rule, item in (("film_scene", "cake"), ("film_scene", f"only_{run}")):
            file = tmp_path / run / f"benchmarks/{rule}/{item}.jsonl"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps({"s": 9.0, "cpu_time": seconds, "max_rss": 10.0}) + "\n")
    write_timings(tmp_path / "after/benchmarks", tmp_path / "timings.csv.gz")
    command = [sys.executable, "-m", "benchmarks.time_per_rule", str(tmp_path / "before"), str(tmp_path / "timings.csv.gz")]
    shown = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert "| film_scene | 1 | 4.0 | 1.0 | 0.25 |" in shown
    assert "only" not in shown
