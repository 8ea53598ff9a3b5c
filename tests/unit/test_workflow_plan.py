"""The plan of a run begins with a summary by stage."""

import logging
import re
from dataclasses import dataclass
from pathlib import Path

import pytest
from snakemake.cli import get_argument_parser
from snakemake_interface_logger_plugins.common import LogEvent

from gsbridge.workflow_plan import STAGES, is_dry, stage_counts, summarize_plans, summary

ROOT = Path(__file__).resolve().parents[2]


@dataclass
class Made:
    """A rule, as far as it is looked at."""

    name: str
    snakefile: str


RULES = [
    Made("train_splats", "/anywhere/rules/splats.smk"),
    Made("film_scene", "/anywhere/rules/film.smk"),
    Made("train_comparison", "/anywhere/rules/splats.smk"),
    Made("all", "/anywhere/Snakefile"),
]
JOBS = {"train_splats": 35, "film_scene": 7, "train_comparison": 66, "all": 1, "total": 109}


def test_every_file_of_rules_is_a_stage_in_the_order_of_the_snakefile():
    included = re.findall(r'^include: "rules/(\w+)\.smk"', (ROOT / "Snakefile").read_text(), re.MULTILINE)
    assert list(STAGES) == [name for name in included if name != "common"]


def test_jobs_are_counted_by_stage():
    assert stage_counts(JOBS, RULES) == {"films of the mirror": 7, "splats": 101}


def test_the_summary_is_no_table_of_rules():
    """`gsbridge status` reads the jobs by rule from the same output."""
    text = summary(stage_counts(JOBS, RULES))
    assert re.search(r"^ +splats +101$", text, re.MULTILINE)
    assert not re.search(r"^\w+ +\d+$", text, re.MULTILINE)


@pytest.mark.parametrize(
    ("command", "dry"),
    [
        (["snakemake", "-n"], True),
        (["/x/snakemake/__main__.py", "-np", "all"], True),
        (["snakemake", "--dry-run", "--", "all"], True),
        (["snakemake", "--config", "n=1"], False),
        (["pytest", "-n"], False),
    ],
)
def test_dry_runs_are_known(command, dry):
    assert is_dry(command, get_argument_parser) is dry


def said(dry, caplog):
    """What is logged of a run that snakemake would tell in these words."""
    logger = logging.getLogger(f"a run of {dry}")
    summarize_plans(logger, lambda: RULES, dry)
    with caplog.at_level(logging.INFO, logger.name):
        logger.info("Workflow has started!", extra={"event": LogEvent.WORKFLOW_STARTED})
        for _ in range(2):
            logger.info("Job stats:\nall 1\n", extra={"event": LogEvent.RUN_INFO, "stats": JOBS})
        logger.info("This was a dry-run (flag -n). The order ..." if dry else "Finished")
    return [record.getMessage() for record in caplog.records]


def test_a_dry_run_begins_and_ends_with_the_summary(caplog):
    begin, end = said(True, caplog)
    assert begin.startswith("Jobs by stage:\n  films of the mirror ")
    assert begin.endswith("Job stats:\nall 1\n")
    assert "  splats " in end
    assert "This was a dry-run" in end
    assert "--quiet rules" in end


def test_a_run_tells_of_its_machine_and_begins_with_the_summary(caplog):
    host, begin, again, end = said(False, caplog)
    assert host == "Workflow has started!"
    assert begin.startswith("Jobs by stage:\n")
    assert again == "Job stats:\nall 1\n"
    assert end == "Finished"
