"""Figures of the area `study`, gathered from its rows under the names of `floors.yaml`.

A figure that cannot be formed from what is there is left out, and the `score` rule then counts it as unmet.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.files import write_json
from gsbridge.report.figures.study import COLUMNS
from gsbridge.report.scores.measured_real2sim import Figure
from gsbridge.report.tables.rows import Row, read_rows

STUDY = "results/rows/study.csv"
IMITATION = ("bc", "dagger")


def study_figures(rows: Sequence[Row]) -> dict[str, Figure]:
    """Leads of SACwB, percentage points of success.

    Args:
        rows: Rows of `study.csv`. Those whose controller is off by more than nothing count as biased.

    Returns:
        `study_lead_min`, over the controller that it learned from, the worse of both; `study_imitation_good` and
        `study_imitation_biased`, over the better of behaviour cloning and DAgger with the same controller.
    """
    out: dict[str, Figure] = {}
    leads: dict[str, float] = {}
    seeds: list[int] = []
    for name, biased in (("good", False), ("biased", True)):
        mine = {row["algo"]: row for row in rows if (float(row["controller_offset_mm"]) > 0) == biased}
        ours, others = mine.get("sacwb"), [mine[algo] for algo in IMITATION if algo in mine]
        if ours is None:
            continue
        rate = float(ours["success_rate"])
        if ours["controller_success_rate"]:
            leads[f"controller {name}"] = 100 * (rate - float(ours["controller_success_rate"]))
            seeds.append(int(ours["seeds"]))
        if len(others) == len(IMITATION):
            best = max(float(row["success_rate"]) for row in others)
            least = min(int(row["seeds"]) for row in (ours, *others))
            out[f"study_imitation_{name}"] = {"value": 100 * (rate - best), "n": 1, "seeds": least, "where": STUDY}
    if len(leads) == 2:
        out["study_lead_min"] = {
            "value": min(leads.values()),
            "n": 2,
            "seeds": min(seeds),
            "interval": [min(leads.values()), max(leads.values())],
            "interval_of": "both controllers",
            "where": STUDY,
        }
    return out


def write_study_figures(out: str | Path, rows_csv: str | Path, preset: str) -> None:
    """Gather the figures of the area and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        rows_csv: `rows/study.csv`.
        preset: Preset that ran.

    Raises:
        InputError: The rows are damaged.
    """
    try:
        figures = study_figures(read_rows(rows_csv, COLUMNS))
    except ValueError as error:
        raise InputError(rows_csv, f"rows of the study are damaged ({error!r})", "Delete them and run again") from error
    write_json(out, {"preset": preset, "figures": figures})
