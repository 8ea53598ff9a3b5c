"""Made-up rows of trials at different severities."""

from gsbridge.report.tables.rows import write_rows
from gsbridge.report.tables.severity_rows import COLUMNS

SIM = ("sim", "", "")


def row(place, renderer, good, *, variant="default", training=1, world=SIM, pose_set="fixed", trials=32):
    """A row as it is written.

    Args:
        place: Task, object and background.
        renderer: What it learned from.
        good: Successes.
        variant: Way of learning.
        training: Seed.
        world: Name, severity of look, severity of physics.
        pose_set: Set of start poses.
        trials: Trials.
    """
    task, item, background = place
    name, look, physics = world
    return {
        "task": task, "object": item, "background": background, "renderer": renderer, "variant": variant,
        "training": training, "world": name, "look": look, "physics": physics, "pose_set": pose_set, "trials": trials,
        "successes": good, "status": "pass", "reasons": "",
    }  # fmt: skip


def lab(level):
    """A world of a severity."""
    return f"lab_{level}", level, level


def both_sets(place, renderer, good, **more):
    """Rows of both sets inside the square: successes of 64, the fixed ones first."""
    fixed = min(good, 32)
    return [row(place, renderer, fixed, **more), row(place, renderer, good - fixed, pose_set="unseen", **more)]


def write(path, rows):
    """Write rows as a file, and return its path."""
    write_rows(path, COLUMNS, rows)
    return path
