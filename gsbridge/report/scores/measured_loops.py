"""Figures of the area `loops`, gathered from the rows of closed loops under the names of `floors.yaml`.

A figure that cannot be formed from what is there is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.files import write_json
from gsbridge.report.figures.loop_rows import COLUMNS
from gsbridge.report.scores.measured_real2sim import Figure
from gsbridge.report.tables.rows import Row, read_rows
from gsbridge.report.tables.statistics import wilson_interval


def loop_figures(rows: Sequence[Row], loops: Sequence[Mapping[str, str]], where: str) -> dict[str, Figure]:
    """Successes of a policy before its world changed and since, and of the one that learned anew.

    Args:
        rows: Rows of a closed loop.
        loops: Of each: `reference` and `world`, the policies `before` and `after`, the latter empty where none learned anew.
        where: Their file.

    Returns:
        `loop_{world}_before`, `loop_{world}_changed` and `loop_{world}_after`, percent.
    """
    found = {(row["variant"], row["world"]): row for row in rows}
    out: dict[str, Figure] = {}
    for loop in loops:
        places = {
            "before": (loop["before"], loop["reference"]),
            "changed": (loop["before"], loop["world"]),
            "after": (loop["after"], loop["world"]),
        }
        for name, place in places.items():
            if place in found:
                good, trials = int(found[place]["successes"]), int(found[place]["trials"])
                out[f"loop_{loop['world']}_{name}"] = {
                    "value": 100 * good / trials,
                    "n": trials,
                    "interval": [100 * limit for limit in wilson_interval(good, trials)],
                    "interval_of": "95 % (Wilson)",
                    "where": where,
                }
    return out


def write_loop_figures(
    out: str | Path, tables: Mapping[str, str | Path], loops: Sequence[Mapping[str, str]], preset: str
) -> None:
    """Gather the figures of the area and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        tables: Rows by name.
        loops: As for `loop_figures`, each with the `table` that it stands in.
        preset: Preset that ran.

    Raises:
        InputError: Rows are damaged.
    """
    figures: dict[str, Figure] = {}
    for name, path in tables.items():
        try:
            mine = [loop for loop in loops if loop["table"] == name]
            figures |= loop_figures(read_rows(path, COLUMNS), mine, f"results/rows/{name}.csv")
        except (KeyError, ValueError) as error:
            raise InputError(path, f"rows of the loop are damaged ({error!r})", "Delete them and run again") from error
    write_json(out, {"preset": preset, "figures": figures})
