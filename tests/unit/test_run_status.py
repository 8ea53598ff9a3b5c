"""What `gsbridge status` reads: snakemake's table of jobs, benchmark files, stages' records."""

import json

from gsbridge.cli import main
from gsbridge.run_status import job_counts, measured_seconds, remaining_jobs, stage_records, stale_rules, told_reason

TABLE = """
Job stats:
job                  count
-----------------  -------
all                      1
film_scene               2
train_policy             1
total                    4

"""


def test_jobs_are_counted_by_rule():
    assert job_counts(TABLE) == {"all": 1, "film_scene": 2, "train_policy": 1}
    assert job_counts("Nothing to be done") == {}


def test_times_are_medians_of_earlier_jobs(tmp_path):
    (tmp_path / "film_scene").mkdir()
    for name, seconds in (("a", 10.0), ("b", 30.0), ("c", 20.0)):
        (tmp_path / "film_scene" / f"{name}.jsonl").write_text(json.dumps({"s": seconds}) + "\n")
    (tmp_path / "fit_light.jsonl").write_text(json.dumps({"s": 4.0}) + "\n")
    assert measured_seconds(tmp_path) == {"film_scene": 20.0, "fit_light": 4.0}


def test_a_damaged_benchmark_file_is_passed_over(tmp_path):
    whole = json.dumps({"s": 4.0}).encode()
    (tmp_path / "fit_light.jsonl").write_bytes(b"\xa9\x00\xff\xfe\n" + b"[" * 100_000 + b"\n" + whole + b"\n")
    (tmp_path / "film_scene.jsonl").write_bytes(bytes(range(256)))
    assert measured_seconds(tmp_path) == {"fit_light": 4.0}


def test_unmeasured_rules_come_first_then_the_longest():
    left = remaining_jobs({"short": 3, "long": 1, "new": 1}, {"short": 2.0, "long": 60.0})
    assert [item.rule for item in left] == ["new", "long", "short"]


def test_records_are_found_with_status_and_reasons(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "sfm.json").write_text(json.dumps({"status": "degraded", "reasons": ["few photos"]}))
    (tmp_path / "a" / "mesh.json").write_text(json.dumps({"status": "pass", "reasons": []}))
    (tmp_path / "a" / "broken.json").write_text("{")
    (tmp_path / "a" / "other.json").write_text(json.dumps({"seed": 1}))
    assert list(stage_records(tmp_path)) == [
        (tmp_path / "a" / "mesh.json", "pass", []),
        (tmp_path / "a" / "sfm.json", "degraded", ["few photos"]),
    ]


def test_stale_is_what_was_made_from_something_else():
    text = """total  4

Reasons:
    (check individual jobs above for details)
    input files updated by another job:
        align_scene, all
    output files have to be generated:
        film_onlooker
    params have changed since last execution:
        film_scene, film_board
    updated input files:
        film_scene
Some jobs were triggered by provenance information, see 'reason' section in the rule displays above.
"""
    assert stale_rules(text) == {
        "film_scene": "params have changed since last execution; updated input files",
        "film_board": "params have changed since last execution",
    }
    assert stale_rules("Nothing to be done") == {}


def test_help_is_no_finished_run(capsys):
    assert main(["status", "--help"]) == 0
    said = capsys.readouterr().out
    assert "degraded stages" in said
    assert "Nothing is left" not in said


def test_help_of_run_is_its_own(capsys):
    assert main(["run", "--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: gsbridge run [arguments of snakemake]")


def test_the_reason_is_told_without_what_snakemake_prints_round_it():
    profile = "Using workflow specific profile profiles/default for setting default command line arguments.\n"
    early = (
        'InputError in file "/p/Snakefile", line 75:\nresults/x: \'x\' is no scene. Name one\n  File "/p/Snakefile", line 75\n'
    )
    assert told_reason(early, profile) == "results/x: 'x' is no scene. Name one"
    late = "Building DAG of jobs...\nError:\n  InputError: a.mp4: not there. Put it there\nWildcards:\n"
    assert told_reason("", profile + late) == "a.mp4: not there. Put it there"
    ours = "Building DAG of jobs...\nERROR results/x: no rule makes this. Name another\n"
    assert told_reason("", profile + ours) == "results/x: no rule makes this. Name another"
    other = "Building DAG of jobs...\nMissingRuleException:\nNo rule to produce b.txt.\n"
    assert told_reason("", profile + other) == "MissingRuleException:\nNo rule to produce b.txt."
