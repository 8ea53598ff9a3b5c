"""Rows of trials at different severities, and what is computed from them: successes by training, means, leads.

Columns of the rows, one for each training, world and set of start poses:

| column | content |
|---|---|
| `task`, `object`, `background` | what the policy does, and where |
| `renderer`, `variant`, `training` | what drew its training pictures, its way of learning, its seed |
| `world`, `look`, `physics` | where it was tried, and the severities of that world, empty for simulation |
| `pose_set` | `fixed`, `unseen` or `outside` |
| `trials`, `successes` | counts; excess contact is forgiven, as in every world but the simulated one |
| `status`, `reasons` | `degraded` where a scene, the policy or its trials are degraded; a bar separates reasons |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from gsbridge.configuration.renderers import TITLES
from gsbridge.errors import InputError
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import Row, read_rows, write_rows
from gsbridge.report.tables.statistics import lead_interval, mean_rate
from gsbridge.report.tables.success_rows import CELL_COLUMNS, STRICT_WORLD, cell_in, read_trial_files
from gsbridge.statistics import Tally
from gsbridge.tasks.poses import POSE_SETS

COLUMNS = (*CELL_COLUMNS, *("training", "world", "look", "physics", "pose_set", "trials", "successes", "status", "reasons"))

BETWEEN_REASONS = " | "
"""Separator of reasons; no semicolon, because a reason may contain one."""

INSIDE, OUTSIDE = ("fixed", "unseen"), ("outside",)
"""Sets of start poses inside the training square, which count together, and beyond it."""

Group = tuple[str, str, str]
"""Renderer, variant and world."""

Place = tuple[str, str, str]
"""Task, object and background."""

Worlds = Mapping[str, tuple[str, str]]
"""Severity of look and of physics by the name of a world."""

Cells = Mapping[Place, Sequence[Tally]]
"""Successes and trials of each training, by cell."""

Tallies = dict[Group, dict[Place, list[Tally]]]
"""Cells of each group, with the successes and trials of each training."""


def write_severity_rows(
    out_csv: str | Path,
    trials: Sequence[str | Path],
    severities: Mapping[str, tuple[int, int]],
    *,
    policies: Sequence[str | Path] = (),
    records: Sequence[str | Path] = (),
) -> None:
    """Write one row per training, world and set of start poses.

    Args:
        out_csv: File to write.
        trials: Tables of trials, each beside its record.
        severities: Severity of look and of physics by the name of a world.
        policies: Records of the trainings.
        records: Records of the stages that made the scenes.

    Raises:
        InputError: A file is missing or damaged, or no world is named.
    """
    if not severities:
        raise InputError("config: study.severity.worlds", "no world is named", "Name worlds of different severity")
    rows = []
    for file in read_trial_files(trials, policies=policies, records=records):
        look, physics = severities.get(file.world, ("", ""))
        for pose_set in POSE_SETS:
            found = file.trials.of(pose_set)
            if len(found):
                rows.append(
                    {
                        **{name: getattr(file.cell, name) for name in CELL_COLUMNS},
                        **{"training": file.seed, "world": file.world, "look": look, "physics": physics},
                        **{"pose_set": pose_set, "trials": len(found), "successes": int(found.judged(file.world).sum())},
                        "status": "degraded" if file.reasons else "pass",
                        "reasons": BETWEEN_REASONS.join(file.reasons),
                    }
                )
    write_rows(out_csv, COLUMNS, rows)


def read_severity_rows(rows_csv: str | Path) -> list[Row]:
    """Read the rows.

    Raises:
        InputError: The rows are damaged, or there are none.
    """
    rows = read_rows(rows_csv, COLUMNS)
    if not rows:
        raise InputError(rows_csv, "it holds no trials", "Delete the file and run the rule again")
    return rows


def tallies_of(rows: Sequence[Row], pose_sets: Sequence[str] = INSIDE) -> Tallies:
    """Successes and trials of each training in some sets of start poses.

    Args:
        rows: Rows of `write_severity_rows`.
        pose_sets: Names of the sets, whose trials count together.
    """
    counts: dict[tuple[Group, Place, str], list[int]] = {}
    for row in rows:
        if row["pose_set"] in pose_sets:
            group = row["renderer"], row["variant"], row["world"]
            place = row["task"], row["object"], row["background"]
            count = counts.setdefault((group, place, row["training"]), [0, 0])
            count[0] += int(row["successes"])
            count[1] += int(row["trials"])
    out: Tallies = {}
    for (group, place, _), (good, tried) in counts.items():
        out.setdefault(group, {}).setdefault(place, []).append((good, tried))
    return out


def worlds_of(rows: Sequence[Row]) -> dict[str, tuple[str, str]]:
    """Severity of look and of physics of the worlds of the rows, mildest first; simulation is left out."""
    found = {row["world"]: (row["look"], row["physics"]) for row in rows if row["world"] != STRICT_WORLD}
    return dict(sorted(found.items(), key=lambda item: (item[1], item[0])))


def severity_label(severity: tuple[str, str]) -> str:
    """Severity in a word: `2`, or `3/1` where look and physics differ."""
    look, physics = severity
    return look if look == physics else f"{look}/{physics}"


def by_severity(rows: Sequence[Row]) -> list[Row]:
    """Replace `world` in each row by its severity's label, so that worlds of one severity count together; keep simulation."""
    return [
        row if row["world"] == STRICT_WORLD else {**row, "world": severity_label((row["look"], row["physics"]))} for row in rows
    ]


@dataclass(frozen=True)
class Lead:
    """Lead of some policies over others: the difference of their mean success over the same cells.

    Args:
        ours: Successes and trials of each training of the leading side, by cell.
        theirs: The same of the other side, for the same cells in the same order.
    """

    ours: Cells
    theirs: Cells

    @classmethod
    def over_common_cells(cls, ours: Cells, theirs: Cells) -> Lead | None:
        """Make the lead over the cells that both sides have; None where they have none in common."""
        common = [place for place in ours if place in theirs]
        return cls({place: ours[place] for place in common}, {place: theirs[place] for place in common}) if common else None

    @property
    def value(self) -> float:
        """Difference of the mean rates, a share."""
        return mean_rate(self.ours.values()) - mean_rate(self.theirs.values())

    @cached_property
    def interval(self) -> tuple[float, float]:
        """95 % interval of `value`, see `lead_interval`."""
        return lead_interval(self.ours.values(), self.theirs.values())


def lead_over_best_mesh(tallies: Tallies, variant: str, world: str, splats: str = "gs") -> tuple[str, Lead] | None:
    """Find the mesh whose policies succeed most often at the same variation of colours, and the lead of splats over it.

    Args:
        tallies: Successes and trials by group.
        variant: Variant of both sides.
        world: World, or severity's label.
        splats: Renderer that is compared with the meshes.

    Returns:
        Renderer of the best mesh, and the lead over the cells that splats and every mesh have; None where there are none.
    """
    meshes = {name: tallies[key] for name in TITLES if "mesh" in name and (key := (name, variant, world)) in tallies}
    ours = tallies.get((splats, variant, world), {})
    common = [place for place in ours if all(place in cells for cells in meshes.values())]
    if not meshes or not common:
        return None
    leads = {
        name: Lead({place: ours[place] for place in common}, {place: cells[place] for place in common})
        for name, cells in meshes.items()
    }
    return min(leads.items(), key=lambda item: item[1].value)


def graded_rates(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Success rate by policy and world, 0..1, from start poses inside the training square."""
    out: dict[str, dict[str, float]] = {}
    counts: dict[tuple[str, str], list[int]] = {}
    for row in rows:
        if row["pose_set"] in INSIDE:
            count = counts.setdefault((f"{row['variant']}, training {row['training']}", row["world"]), [0, 0])
            count[0] += int(row["successes"])
            count[1] += int(row["trials"])
    for (policy, world), (good, tried) in counts.items():
        out.setdefault(policy, {})[world] = good / tried
    return out


def graded_pairs(rates: Mapping[str, Mapping[str, float]], world: str) -> tuple[list[float], list[float]]:
    """Success in simulation and in another world, for the policies that were tried in both.

    Args:
        rates: Rates as `graded_rates` gives them.
        world: World, or severity's label.
    """
    both = [found for found in rates.values() if STRICT_WORLD in found and world in found]
    return [found[STRICT_WORLD] for found in both], [found[world] for found in both]


def resting(rows: Sequence[Row]) -> str:
    """State in a sentence how many cells, trainings, starts and worlds the rows rest on."""
    groups = tallies_of(rows)
    trainings = sorted({len(cell) for cells in groups.values() for cell in cells.values()})
    starts = sorted({tried for cells in groups.values() for cell in cells.values() for _, tried in cell})
    places = {place for cells in groups.values() for place in cells}
    worlds = [f"{world} (severity {severity_label(found)})" for world, found in worlds_of(rows).items()]
    every = (["simulation"] if any(row["world"] == STRICT_WORLD for row in rows) else []) + worlds
    return (
        f"Rests on {_counted([len(places)], 'cell')}, {_counted(trainings, 'training')} of each policy, and "
        f"{_counted(starts, 'start')} of each training inside the training square, in {', '.join(every)}."
        + (" The intervals of one training say nothing of other trainings." if trainings[:1] == [1] else "")
    )


def _counted(counts: Sequence[int], noun: str) -> str:
    """Counts with their noun: `1 cell`, `1 to 3 trainings`."""
    span = " to ".join(map(str, dict.fromkeys((counts[0], counts[-1])))) if counts else "0"
    return f"{span} {noun}" if span == "1" else f"{span} {noun}s"


def doubts(rows: Sequence[Row]) -> list[str]:
    """List why policies or trials are degraded, each reason with the number of trainings it concerns, as lines of a page."""
    reasons: dict[str, set[tuple[CellPaths, str]]] = {}
    for row in rows:
        for reason in filter(None, row["reasons"].split(BETWEEN_REASONS)):
            reasons.setdefault(reason, set()).add((cell_in(row), row["training"]))
    listed = [f"- {why} ({len(who)} {'policy' if len(who) == 1 else 'policies'})" for why, who in sorted(reasons.items())]
    return ["", "Degraded:", "", *listed] if listed else []
