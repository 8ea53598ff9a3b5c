"""What `gsbridge status` reads: snakemake's table of jobs, benchmark files, stages' records."""

import json

from gsbridge.run_status import degraded_records, job_counts, measured_seconds, remaining_jobs

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


def test_unmeasured_rules_come_first_then_the_longest():
    left = remaining_jobs({"short": 3, "long": 1, "new": 1}, {"short": 2.0, "long": 60.0})
    assert [item.rule for item in left] == ["new", "long", "short"]


def test_degraded_records_are_found_with_their_reasons(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "sfm.json").write_text(json.dumps({"status": "degraded", "reasons": ["few photos"]}))
    (tmp_path / "a" / "mesh.json").write_text(json.dumps({"status": "pass", "reasons": []}))
    (tmp_path / "a" / "broken.json").write_text("{")
    assert list(degraded_records(tmp_path)) == [(tmp_path / "a" / "sfm.json", ["few photos"])]
