"""Cases of the gap and their benchmark, as users run them; bad input ends with one sentence and leaves nothing behind."""

import os
import re
from pathlib import Path

import numpy as np
import pytest

URDF = """<robot name="axis"><link name="base"/><link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
<inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axis" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 -1 0"/>
<limit lower="-6" upper="6" effort="50" velocity="20"/></joint></robot>"""
MODEL = "urdf: axis.urdf\ncontroller: {mode: pd, stiffness: 60, damping: 4, gravity_compensation: 1.0}\n"
STEPS = ("read_gap_records", "compare_gap", "screen_gap", "identify_gap", "replay_gap", "report_gap")


def table(count: int = 300) -> tuple[list[str], np.ndarray]:
    """A log of a single axis that is well: header and rows."""
    time = np.arange(count) / 100
    q = 0.5 * np.sin(3 * time)
    header = ["time [s]", "command.axis [rad]", "position.axis [rad]", "velocity.axis [rad/s]"]
    return header, np.stack([time, q, q, 1.5 * np.cos(3 * time)], axis=1)


def write_case(folder: Path, header: list[str], rows: np.ndarray, model: str = MODEL) -> Path:
    """A case of one record that is split; returns its file."""
    folder.mkdir(parents=True)
    (folder / "axis.urdf").write_text(URDF)
    (folder / "model.yaml").write_text(model)
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=",".join(header), comments="")
    (folder / "case.yaml").write_text("model: model.yaml\nrecords: {fit: log.csv}\n")
    return folder / "case.yaml"


def write_thrown_case(folder: Path, columns: str = "throw,time [s],position.x [m]") -> Path:
    """A case about a thrown box whose log lacks most of its columns; returns its file."""
    folder.mkdir(parents=True)
    (folder / "model.yaml").write_text("box: [0.1, 0.1, 0.1]\nmass: 0.4\ncontroller: {mode: body}\ncontact: {friction: 0.5}\n")
    np.savetxt(folder / "log.csv", np.zeros((20, columns.count(",") + 1)), delimiter=",", header=columns, comments="")
    (folder / "case.yaml").write_text("model: model.yaml\nrecords: {fit: log.csv}\n")
    return folder / "case.yaml"


def write_photo_case(folder: Path) -> Path:
    """A case of pictures without any picture; returns its file."""
    folder.mkdir(parents=True)
    nominal = Path(__file__).resolve().parents[2] / "models/nominal.yaml"
    (folder / "case.yaml").write_text(f"model: {nominal}\nphotos: {{views: views, before: before, after: after}}\n")
    return folder / "case.yaml"


def planned(plan: str) -> set[str]:
    """Rules of a dry run."""
    return set(re.findall(r"^(\w+) +\d+$", plan.split("Job stats:")[1].split("total")[0], re.MULTILINE))


@pytest.mark.parametrize("kind", ["mechanism", "thrown", "photos"])
def test_a_case_is_named_by_its_file_alone(snakemake, tmp_path, kind):
    """Whether it is about a mechanism, a thrown body or pictures: the same targets."""
    folder = tmp_path / "My axis"
    write = {"thrown": write_thrown_case, "photos": write_photo_case}.get(kind, lambda folder: write_case(folder, *table()))
    case = write(folder)
    plan = snakemake("--dry-run", "--directory", str(tmp_path / "run"), "--config", f"gap_case={case}", "--", "gap").stdout
    assert planned(plan) == {*STEPS, "record_gap", "collect_gap", "gap"}
    assert "results/gap/my_axis/report.html" in plan


def test_an_older_log_in_the_place_of_a_newer_one_is_read(snakemake, tmp_path):
    """As when the second of two recordings is moved over the first: its date is before that of the results."""
    header, rows = table(900)
    case = write_case(tmp_path / "axis", header, rows)
    asked = ["--cores", "1", "--directory", str(tmp_path / "run"), "--config", f"gap_case={case}", "--"]
    snakemake(*asked, "results/gap/axis/records.json")
    again = ["--dry-run", *asked, "results/gap/axis/records.json"]
    assert "Nothing to be done" in snakemake(*again).stdout
    second = tmp_path / "second.csv"
    np.savetxt(second, rows * [1, 1, 1.01, 1], delimiter=",", header=",".join(header), comments="")
    os.utime(second, (1e9, 1e9))
    second.replace(case.parent / "log.csv")
    assert planned(snakemake(*again).stdout) == {"read_gap_records"}


def test_throws_give_the_model_that_a_policy_learns_with(snakemake, tmp_path):
    case = write_thrown_case(tmp_path / "My cube")
    asked = ["--config", f"gap_case={case}", "--", "results/gap/my_cube/simulation.yaml"]
    plan = snakemake("--dry-run", "--directory", str(tmp_path / "run"), *asked).stdout
    assert planned(plan) == {"copy_project_file", "read_gap_records", "screen_gap", "identify_gap", "amend_object"}


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ("results/gap/axsi/report.html", "Did you mean 'axis'?"),
        ("results/gap/axis/report.html", "lost.yaml. Correct the path of the case"),
    ],
)
def test_cases_that_are_not_there_are_named(snakemake, tmp_path, target, said):
    arguments = ["--directory", str(tmp_path / "run"), "--config", "gap={cases: {axis: lost.yaml}}", "--", target]
    process = snakemake("--dry-run", *arguments, check=False)
    assert process.returncode != 0
    assert said in process.stdout + process.stderr
    assert not (tmp_path / "run/results").exists()


@pytest.mark.parametrize(
    ("records", "said"),
    [
        ("{fit: lost.csv}", r"ERROR \S+case\.yaml: the record 'fit' is missing: there is no \S+lost\.csv\. Correct its line"),
        ("{fitt: log.csv}", r"ERROR \S+case\.yaml: 'fitt' under 'records' is no role of a record\. Did you mean 'fit'\?"),
    ],
)
def test_records_that_are_not_there_are_named_before_anything_runs(snakemake, tmp_path, records, said):
    case = write_case(tmp_path / "axis", *table())
    case.write_text(f"model: model.yaml\nrecords: {records}\n")
    process = snakemake(
        "--dry-run", "--directory", str(tmp_path / "run"), "--config", f"gap_case={case}", "--", "gap", check=False
    )
    assert process.returncode != 0
    assert len(re.findall(said, process.stdout + process.stderr)) == 1
    assert "Traceback" not in process.stdout + process.stderr


def test_bad_records_end_with_one_sentence_and_leave_nothing(snakemake, tmp_path):
    """Several cases in one run: each fails by itself, and says why."""
    header, rows = table()
    backwards, broken, degrees = rows.copy(), rows.copy(), rows.copy()
    backwards[[100, 101], 0] = backwards[[101, 100], 0]
    broken[50, 2] = np.nan
    degrees[:, 2] = np.degrees(degrees[:, 2])
    bad = {
        "backwards": (write_case(tmp_path / "a", header, backwards), "at data row"),
        "broken": (write_case(tmp_path / "b", header, broken), "'position.axis' holds no number in data row 51"),
        "degrees": (write_case(tmp_path / "c", header, degrees), "it looks like"),
        "stranger": (
            write_case(tmp_path / "d", header, rows, MODEL.replace("urdf: axis.urdf", "urdf: axis.urdf\njoints: [elbow]")),
            "the URDF has no moving joint 'elbow'",
        ),
        "thrown": (write_thrown_case(tmp_path / "e"), "the column 'position.y' is missing"),
        "photos": (write_photo_case(tmp_path / "f"), "views.json"),
    }
    cases = ", ".join(f"{name}: {path}" for name, (path, _) in bad.items())
    process = snakemake(
        "--cores", "1", "--directory", str(tmp_path / "run"), "--config", f"gap={{cases: {{{cases}}}}}", "--",
        *(f"results/gap/{name}/report.html" for name in bad), check=False,
    )  # fmt: skip
    assert process.returncode != 0
    for name, (_, said) in bad.items():
        log = (tmp_path / f"run/results/logs/read_gap_records/{name}.log").read_text()
        assert said in log
        assert len(log.strip().splitlines()) == 1
        assert not list((tmp_path / "run/results").glob(f"gap/{name}/*"))
    assert "Traceback" not in process.stdout + process.stderr


def test_a_refused_log_leaves_earlier_results_as_they_were(snakemake, tmp_path):
    header, rows = table(700)
    case = write_case(tmp_path / "axis", header, rows)
    asked = ["--cores", "1", "--directory", str(tmp_path / "run"), "--config", f"gap_case={case}", "--"]
    asked.append("results/gap/axis/records.json")
    snakemake(*asked)
    made = {path.name: path.read_bytes() for path in (tmp_path / "run/results/gap/axis").iterdir()}
    assert {"records.json", "records.npz"} <= set(made)
    rows[50, 2] = np.nan
    np.savetxt(case.parent / "log.csv", rows, delimiter=",", header=",".join(header), comments="")
    for _ in range(2):  # The same command is refused again: the records are those of the earlier log.
        process = snakemake(*asked, check=False)
        assert process.returncode != 0
        assert "holds no number" in process.stdout + process.stderr
        assert {path.name: path.read_bytes() for path in (tmp_path / "run/results/gap/axis").iterdir()} == made


def test_the_toys_benchmark_is_small_and_the_truth_is_apart(snakemake, tmp_path):
    target = "results/gap-benchmark/report.html"
    plan = snakemake("--dry-run", "--directory", str(tmp_path), "--config", "preset=toy", "--", target).stdout
    benchmark = {"generate_gap_cases", "diagnose_joint_cases", "score_gap_cases", "report_gap_benchmark"}
    # The page shows floors, which lie in the project.
    assert planned(plan) == benchmark | {"copy_project_file"}
    assert "chunk 0 of 1" in plan
    for tier, there in (("t0", True), ("t1", False), ("t2", True)):
        assert (f"cases of tier {tier}" in plan) == there
    jobs = re.split(r"\n(?=Job \d+:)", plan)
    diagnosing = [job for job in jobs if "Diagnose tier" in job]
    assert len(diagnosing) == 2
    assert not any("truth" in job for job in diagnosing)


def test_the_study_has_every_way_of_naming(snakemake, tmp_path):
    plan = snakemake("--dry-run", "--directory", str(tmp_path), "--", "results/scores/gap_rivals.json").stdout
    for tier in ("t1", "t2"):
        for method in ("gsbridge", "largest_change", "training_bic", "cosine", "sparse", "group_lasso"):
            assert f"Diagnose tier {tier} by {method}, chunk 3 of 4" in plan


@pytest.mark.parametrize(
    ("area", "tiers"),
    [("gap", {"t0", "t1", "t2", "t7"}), ("gap_bodies", {"t5"}), ("gap_pictures", {"t4"}), ("gap_real", set())],
)
def test_an_area_of_the_gap_needs_its_own_tiers_alone(snakemake, tmp_path, area, tiers):
    """Other ways of naming simulate more than all else together; each part is measured in some hours."""
    plan = snakemake("--dry-run", "--directory", str(tmp_path), "--", f"results/scores/{area}.json").stdout
    assert set(re.findall(r"Diagnose tier (\w+) by gsbridge", plan)) == tiers
    assert set(re.findall(r"Diagnose tier \w+ by (\w+)", plan)) <= {"gsbridge"}
    assert ("whose truth follows laws of its own" in plan) == (area == "gap")
    assert ("Film" in plan) == (area == "gap_pictures")


@pytest.mark.parametrize(
    ("named", "real", "arm"),
    [
        ({}, False, False),
        ({"GSBRIDGE_MEASURED": "x"}, True, False),
        ({"GSBRIDGE_MEASURED": "x", "GSBRIDGE_ROBOTS": "y"}, True, True),
    ],
    ids=["nothing", "logs", "logs and an arm"],
)
def test_real_logs_are_diagnosed_where_their_folders_are_named(snakemake, tmp_path, named, real, arm):
    plan = snakemake("--dry-run", "--directory", str(tmp_path), "--", "results/scores/gap_real.json", **named).stdout
    assert ("Diagnose tosses of a real cube" in plan) == real
    assert ("Diagnose a real arm from three motions" in plan) == arm
