"""Files of policies and their trials, made up from chosen numbers of successes, for the tests of the reports."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gsbridge.files import write_json
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import write_rows
from gsbridge.report.tables.success_rows import TRIAL_COLUMNS

SETS = ("fixed", "unseen")


def trial_rows(successes: Mapping[str, int], *, count: int = 32, failure: str = "not_grasped", forgiven: int = 0) -> list[dict]:
    """Rows of a trial file: so many successes per set of poses, at random places.

    Args:
        successes: By set of poses, by all rules.
        count: Poses of each set.
        failure: Reason of the others.
        forgiven: So many of the others fail for excess contact alone.
    """
    rng = np.random.default_rng(7)
    rows = []
    for pose_set, good in successes.items():
        order = rng.permutation(count)
        for index in range(count):
            place = int(np.flatnonzero(order == index)[0])
            success, excess = place < good, good <= place < good + forgiven
            word = "" if success else "excess_contact" if excess else failure
            rows.append(
                {
                    "pose_set": pose_set,
                    "index": index,
                    "quadrant": index // 8 + 1,
                    **dict.fromkeys(("x", "y", "yaw"), 0.1),
                    "success": success,
                    "success_tolerant": success or excess,
                    "failure": word,
                    "steps": 60,
                    "clipped": 0,
                    "refused": 0,
                }
            )
    return rows


def path_of(root: Path, folder: str, cell: CellPaths) -> Path:
    """Folder of a cell's policies or trials."""
    pair = f"{cell.object}+{cell.background}"
    return root / "results" / folder / cell.task / pair / cell.renderer / cell.variant


def write_trials(
    root: Path, cell: CellPaths, world: str, rows: Sequence[Mapping], *, seed: int = 1, reasons: Sequence[str] = ()
) -> Path:
    """A trial file and its record."""
    path = path_of(root, "trials", cell) / world / f"seed{seed}.csv"
    write_rows(path, TRIAL_COLUMNS, rows)
    status = "degraded" if reasons else "pass"
    write_json(path.with_suffix(".json"), {"status": status, "reasons": list(reasons), "world": world})
    return path


def write_policy(
    root: Path, cell: CellPaths, success: Sequence[float], *, seed: int = 1, seconds: float = 60.0, **more: object
) -> tuple[Path, Path]:
    """A policy's record and learning curve: an evaluation every 1000 steps, each part of the work takes `seconds` between."""
    folder = path_of(root, "policies", cell) / f"seed{seed}"
    rows = []
    for k, value in enumerate(success, 1):
        row = {"episode": 20 * k, "step": 1000 * k, "success": float(value), "controller_success": 0.9375}
        row |= {f"cpu_{part}_s": seconds * k for part in ("environment", "act", "update", "evaluate")}
        rows.append(row)
    # As `gsbridge.policy.curve` writes it, but without waiting for torch.
    text = [",".join(rows[0]), *(",".join(map(repr, row.values())) for row in rows)]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "training.csv").write_text("\n".join(text) + "\n")
    figures = {"seed": seed, "success": float(max(success)), "retest_success": 0.96875, "controller_success": 0.9375}
    figures |= {"steps": 1000 * len(success), "replay_mb": 150.0}
    write_json(folder / "training.json", {"status": "pass", "reasons": [], "algo": "sacwb", **figures, **more})
    return folder / "training.json", folder / "training.csv"
