"""A summary of a run by stage, shown before snakemake's own tables and its list of hundreds of jobs."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

STAGES = {
    "film": "films of the mirror",
    "capture": "keyframes",
    "sfm": "cameras",
    "align": "scale and table",
    "registration": "place of the arm",
    "masks": "masks",
    "mesh": "meshes",
    "splats": "splats",
    "assets": "assets for the simulation",
    "views": "robot, light and colours",
    "simulator": "a controller in both worlds",
    "policies": "policies: trainings and trials",
    "behaviour": "policies: films and behaviour",
    "study": "ways of learning compared",
    "episodes": "episodes",
    "editing": "edits",
    "gap": "the gap in your logs",
    "gap_benchmark": "the gap: blind cases",
    "loop": "closed loops",
    "controls": "controls of the closed loops",
    "picture_gap": "closed loops of pictures",
    "report": "tables, figures, pages",
    "recordings": "recordings for rerun",
    "scores": "scores",
}
"""What the rules of each file of `rules/` make, in the order in which the Snakefile includes them."""

_DRY = "This was a dry-run"
"""How the last line of a dry run begins."""

_HINT = "`--quiet rules` leaves out the list of jobs; `gsbridge status` tells about how long they take."


class Rule(Protocol):
    """The attributes of snakemake's rules that are used here."""

    name: str
    snakefile: str


def stage_counts(jobs: Mapping[str, int], rules: Iterable[Rule]) -> dict[str, int]:
    """Number of jobs by stage, in the order of the stages; the total and rules that only name targets do not count.

    Args:
        jobs: Number of jobs by rule.
        rules: All rules of the workflow.
    """
    files = {rule.name: Path(str(rule.snakefile)).stem for rule in rules}
    counts: dict[str, int] = {}
    for rule, count in jobs.items():
        if rule in files and files[rule] in STAGES:
            counts[files[rule]] = counts.get(files[rule], 0) + count
    return {words: counts[stage] for stage, words in STAGES.items() if stage in counts}


def summary(counts: Mapping[str, int]) -> str:
    """Jobs by stage as a table, a line each.

    Args:
        counts: Number of jobs by stage.
    """
    lines = [f"  {words:32s}{count:5d}" for words, count in counts.items()]
    return "\n".join(["Jobs by stage:", *lines])


def is_dry(command: Sequence[str], parser: Callable[[], argparse.ArgumentParser]) -> bool:
    """Whether a call of snakemake only plans; false where the program is another one.

    Args:
        command: The program and its arguments.
        parser: Returns the parser of snakemake's arguments.
    """
    program = Path(command[0])
    if "snakemake" not in (program.name, program.parent.name):
        return False
    return bool(parser().parse_known_args(command[1:])[0].dryrun)


def summarize_plans(logger: logging.Logger, rules: Callable[[], Iterable[Rule]], dry: bool) -> None:
    """Put a summary by stage before snakemake's plan; a dry run also ends with it, in place of snakemake's second table.

    A dry run also leaves out the lines about the machine, so that the summary comes first.

    Args:
        logger: Snakemake's logger.
        rules: Returns the rules of the workflow; called once all are known.
        dry: Whether the run only plans.
    """
    told: list[str] = []

    def summarize(record: logging.LogRecord) -> bool:
        event = getattr(record, "event", None)
        if event == "run_info" and not told:
            told.append(summary(stage_counts(getattr(record, "stats", {}), rules())))
            record.msg = f"{told[0]}\n\n{record.msg}"
        elif told and str(record.msg).startswith(_DRY):
            record.msg = f"\n{told[0]}\n\n{record.msg}\n{_HINT}"
        elif event in ("run_info", "workflow_started"):
            return not dry
        return True

    logger.addFilter(summarize)


__all__ = ["STAGES", "is_dry", "stage_counts", "summarize_plans", "summary"]
