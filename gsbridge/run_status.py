"""Progress of a run: stages that are done, degraded or stale and why, jobs that are left, and about how long they will take."""

from __future__ import annotations

import json
import os
import re
import statistics
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gsbridge.errors import GsbridgeError
from gsbridge.workflow_files import check_configuration_files, check_targets, check_workflow, configuration_files
from gsbridge.workflow_lock import working_folder

_JOB_COUNT = re.compile(r"^(\w+) +(\d+)$", re.MULTILINE)
_REASON = re.compile(r"^ {4}(\w[^:\n]*):\n {8}(\w[\w, ]*)$", re.MULTILINE)
_SENTENCE = re.compile(r"^ERROR (.+)$|^InputError in file .*:\n(.+)$|^ +InputError: (.+)$", re.MULTILINE)
_NOT_STALE = ("output files have to be generated", "input files updated by another job")
"""Snakemake's reasons for files that are missing or that follow from another job; any other means that something changed."""


@dataclass(frozen=True)
class Remaining:
    """Jobs of one rule that are still to run.

    Args:
        rule: Name of the rule.
        jobs: Number of its jobs that are left.
        seconds: Median wall time of one job, s, from jobs of this rule that ran here before; None if none did.
    """

    rule: str
    jobs: int
    seconds: float | None


def stage_records(results: Path) -> Iterator[tuple[Path, str, list[str]]]:
    """Paths of the stages' records below a folder, each with its status and the reasons for a degraded one."""
    for path in sorted(results.rglob("*.json")):
        if ".state" in path.parts or "truth" in path.parts:
            continue
        try:
            record = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if isinstance(record, dict) and record.get("status") in ("pass", "degraded"):
            yield path, record["status"], [str(reason) for reason in record.get("reasons", [])]


def job_counts(text: str) -> dict[str, int]:
    """Number of jobs by rule, as snakemake's dry run prints them under `Job stats`."""
    _, _, table = text.partition("Job stats:")
    counts = {rule: int(count) for rule, count in _JOB_COUNT.findall(table)}
    counts.pop("total", None)
    return counts


def stale_rules(text: str) -> dict[str, str]:
    """Rules whose results are there but would be made anew, and why, as snakemake's dry run prints it under `Reasons`."""
    _, _, listed = text.partition("Reasons:\n")
    found: dict[str, str] = {}
    for reason, rules in _REASON.findall(listed):
        for rule in rules.split(", ") if reason not in _NOT_STALE else ():
            found[rule] = f"{found[rule]}; {reason}" if rule in found else reason
    return found


def measured_seconds(benchmarks: Path) -> dict[str, float]:
    """Median wall time of one job by rule, s, from the benchmark files of earlier jobs."""
    found: dict[str, list[float]] = {}
    for path in benchmarks.rglob("*.jsonl"):
        rule = path.relative_to(benchmarks).parts[0].removesuffix(".jsonl")
        # A disk that was full or failed leaves anything; lines that are no measurement are passed over.
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            try:
                seconds = float(json.loads(line)["s"])
            except (ValueError, KeyError, TypeError, RecursionError):
                continue
            found.setdefault(rule, []).append(seconds)
    return {rule: statistics.median(times) for rule, times in found.items()}


def remaining_jobs(counts: Mapping[str, int], seconds: Mapping[str, float]) -> list[Remaining]:
    """Jobs left by rule, the longest first; rules that were never measured come first of all."""
    left = [Remaining(rule, count, seconds.get(rule)) for rule, count in counts.items()]
    return sorted(left, key=lambda item: -(float("inf") if item.seconds is None else item.jobs * item.seconds))


def told_reason(out: str, error: str) -> str:
    """Pick from all that snakemake printed why it could not plan a run: gsbridge's own sentence, or else the end of the text.

    Snakemake prints errors of the Snakefile to its output and all others to the error stream, each amid lines of context.

    Args:
        out: What snakemake printed to its output.
        error: What snakemake printed to the error stream.
    """
    text = f"{error}\n{out}".strip()
    found = _SENTENCE.search(text)
    return next(filter(None, found.groups())) if found else text.rpartition("Building DAG of jobs...")[2].strip()


def run_status(arguments: Sequence[str]) -> Iterator[str]:
    """Lines that tell the status of the run that the given arguments of snakemake describe.

    Args:
        arguments: Arguments as on snakemake's command line, targets and `--config` included.

    Raises:
        GsbridgeError: A file of `--configfile` cannot be used, an option would swallow a target, there is no workflow here, or
            snakemake cannot plan the run; its message follows.
    """
    check_targets(arguments)
    check_configuration_files(configuration_files(arguments))
    check_workflow(arguments)
    command = [sys.executable, "-m", "snakemake", "--dry-run", "--quiet", "rules", "--nolock", *arguments]
    planned = subprocess.run(command, capture_output=True, text=True, check=False)
    if planned.returncode:
        raise GsbridgeError(f"the run cannot be planned: {told_reason(planned.stdout, planned.stderr)}")
    results = working_folder(arguments) / "results"
    left = remaining_jobs(job_counts(planned.stdout + planned.stderr), measured_seconds(results / "benchmarks"))
    records = list(stage_records(results)) if results.is_dir() else []
    degraded = [(path, reasons) for path, status, reasons in records if status == "degraded"]
    if not left:
        yield "Nothing is left to do."
    for item in left:
        time = "not measured here yet" if item.seconds is None else f"{item.seconds:.0f} s each"
        yield f"  {item.jobs:4d} x {item.rule:32s} {time}"
    if left:
        cores = os.cpu_count() or 1
        total = sum(item.jobs * item.seconds for item in left if item.seconds is not None)
        unknown = sum(item.jobs for item in left if item.seconds is None)
        aside = f", beside {unknown} of rules that were not measured here yet" if unknown else ""
        jobs = sum(item.jobs for item in left)
        about = f"about {total / cores / 60:.0f} minutes on {cores} cores{aside}"
        yield f"{jobs} jobs are left: {about if unknown < jobs else 'none of their rules was measured here yet'}."
    stale = stale_rules(planned.stdout + planned.stderr)
    if stale:
        yield "Stale, since what they are made from has changed; what builds on them follows:"
    for rule, reason in stale.items():
        yield f"  {rule}: {reason}"
    yield f"{len(records)} records of stages are there, {len(degraded)} of them degraded{':' if degraded else '.'}"
    for path, reasons in degraded:
        yield f"  {path.relative_to(results)}: {'; '.join(reasons)}"
