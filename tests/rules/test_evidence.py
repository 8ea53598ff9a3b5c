"""`make evidence` measures all recorded figures again, even in a clone that already holds the records."""

import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def calls_of_make() -> list[list[str]]:
    """What each part gives to snakemake."""
    said = subprocess.run(["make", "--dry-run", "evidence"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [shlex.split(re.sub(r"^.*? run ", "", line)) for line in said.splitlines() if line.startswith("GSBRIDGE_SEAL")]


def test_all_parts_of_the_evidence_are_measured_anew(snakemake, tmp_path):
    calls = calls_of_make()
    parts = re.search(r"^PARTS := (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert parts is not None
    assert len(calls) == len(parts[1].split())
    (options,) = {tuple(call[: call.index("--")]) for call in calls}
    targets = [target for call in calls for target in call[call.index("--") + 1 :]]
    # A clone holds the records, but not the results.
    shutil.copytree(ROOT / "benchmarks/scores", tmp_path / "benchmarks/scores")
    plan = snakemake(
        "--dry-run", "--quiet", "rules", "--directory", str(tmp_path), *options, "--", *targets, GSBRIDGE_SEAL="20001"
    )
    jobs = dict(re.findall(r"^(\w+) +(\d+)$", plan.stdout, re.MULTILINE))
    records = [target for target in targets if target.startswith("benchmarks/scores/")]
    assert int(jobs["record_scores"]) == len(set(records)) == 15
    for score in ("real2sim", "shapes", "photos", "simulator", "policies", "worlds", "severity", "worth"):
        assert jobs[f"score_{score}"] == "1"
    assert jobs["score_gap"] == "5"
    assert jobs["collect_worth"] == "2"
    assert jobs["collect_severity_cells"] == "1"


def test_wall_times_count_where_they_were_measured(snakemake, config, write_config, tmp_path):
    """The list that a rule makes of one file is no path: figures were called damaged as soon as there was a time."""
    config["cells"] = []
    times = tmp_path / "results/benchmarks/wall_times.json"
    times.parent.mkdir(parents=True)
    times.write_text(json.dumps({"make_toy": {"wall_s": 300.0, "cores": 2}}))
    call = [*write_config(config), "--cores", "1", "--directory", str(tmp_path), "--", "results/scores/policies.json"]
    snakemake(*call)
    measured = json.loads((tmp_path / "results/scores/measured/policies.json").read_text())
    assert measured["figures"]["make_toy_wall"]["value"] == pytest.approx(5.0)
