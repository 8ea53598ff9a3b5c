"""Behaviour consistency: how far apart the hand's paths are when a policy starts from the same pose in two worlds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.report.figures.behaviour_drawing import Block, PolicyLine, write_behaviour_figure
from gsbridge.report.figures.paired_trials import SIM, ShownTrials, Start, read_starts
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import write_rows
from gsbridge.tasks.poses import POSE_SETS

COLUMNS = (
    *("task", "object", "background", "renderer", "variant", "world", "pose_set", "trials"),
    *("distance_mm_median", "distance_mm_p90", "sim_successes", "world_successes", "same_outcome"),
)
"""One row per policy, world other than `sim`, and pose set. Distances as in `gsbridge.report.figures.path_distance`; successes
are counts, as the tables count them; `same_outcome` counts the start poses at which both worlds succeeded or both failed."""


@dataclass(frozen=True)
class Behaviour:
    """Trials of one policy in simulation and other worlds.

    Args:
        cell: What the policy learned.
        starts: All its start poses, of all seeds.
    """

    cell: CellPaths
    starts: tuple[Start, ...]

    @property
    def worlds(self) -> list[str]:
        """Worlds that simulation is compared with."""
        return [world for world in self.starts[0].trials if world != SIM]

    @cached_property
    def distances_mm(self) -> dict[str, Array]:
        """Distance between the hand's paths in simulation and in another world, by that world, mm. [N] each."""
        return {world: np.array([start.distance_mm(world) for start in self.starts]) for world in self.worlds}


def write_behaviour(policies: Sequence[tuple[CellPaths, Sequence[ShownTrials]]], figure: str | Path, rows: str | Path) -> None:
    """Compare the hand's paths of all policies: rows for each, and the paper's figure.

    The figure shows the cells whose policies learned from several renderers, splats first; without such a cell, it shows the
    first policy. It compares simulation with the first policy's first other world.

    Args:
        policies: Each with its trials in `sim` and in at least one other world, the same for all.
        figure: PNG, PDF or SVG.
        rows: CSV with `COLUMNS`.

    Raises:
        InputError: There is no policy, trials are missing or damaged, or there is no second world.
    """
    if not policies:
        raise InputError(figure, "there is no policy to compare", "Name a cell whose scenes are filmed in the mirror")
    found = [Behaviour(cell, tuple(read_starts(files))) for cell, files in policies]
    for behaviour in found:
        if SIM not in behaviour.starts[0].trials or not behaviour.worlds:
            raise InputError(figure, f"{behaviour.cell} was not tried in two worlds", "Try it in sim and in another world")
    world = found[0].worlds[0]
    blocks = [_block(members, world) for members in _shown(found)]
    lines = [_line(behaviour, world) for behaviour in found]
    write_behaviour_figure(blocks, lines, world, figure)
    write_rows(rows, COLUMNS, [row for behaviour in found for row in consistency_rows(behaviour)])


def consistency_rows(behaviour: Behaviour) -> list[dict]:
    """Make the rows of one policy, see `COLUMNS`."""
    out = []
    for world in behaviour.worlds:
        for pose_set in POSE_SETS:
            chosen = np.array([start.pose_set == pose_set for start in behaviour.starts])
            if not chosen.any():
                continue
            trials = [start.trials for start, use in zip(behaviour.starts, chosen, strict=True) if use]
            distances = behaviour.distances_mm[world][chosen]
            sim, other = (np.array([trial[name].success for trial in trials]) for name in (SIM, world))
            out.append(
                {
                    **vars(behaviour.cell),
                    "world": world,
                    "pose_set": pose_set,
                    "trials": len(trials),
                    "distance_mm_median": float(np.median(distances)),
                    "distance_mm_p90": float(np.quantile(distances, 0.9)),
                    "sim_successes": int(sim.sum()),
                    "world_successes": int(other.sum()),
                    "same_outcome": int((sim == other).sum()),
                }
            )
    return out


def most_typical(distances: Sequence[Array]) -> int:
    """Find the start pose whose distances rank nearest to the medians of several policies. [N] each -> 0..N - 1.

    A picture of one trial stands for all of them: neither the best nor the worst is shown.
    """
    ranks = [np.argsort(np.argsort(values, kind="stable"), kind="stable") for values in distances]
    away = np.abs(np.stack(ranks) - 0.5 * (len(ranks[0]) - 1)).sum(axis=0)
    return int(np.argmin(away))


def _shown(found: Sequence[Behaviour]) -> list[list[Behaviour]]:
    """Choose the figure's policies, by block: cells with more than one renderer, splats first, or the first policy alone."""
    cells: dict[tuple[str, ...], list[Behaviour]] = {}
    for behaviour in found:
        cell = behaviour.cell
        cells.setdefault((cell.task, cell.object, cell.background, cell.variant), []).append(behaviour)
    several = [members for members in cells.values() if len(members) > 1]
    return [sorted(members, key=lambda one: one.cell.renderer != "gs") for members in several] or [[found[0]]]


def _block(members: Sequence[Behaviour], world: str) -> Block:
    """Make the block of one cell: all its renderers, shown from one start pose where they share all start poses."""
    keys = [[(start.seed, start.pose_set, start.index) for start in member.starts] for member in members]
    same = all(key == keys[0] for key in keys)
    values = [member.distances_mm[world] for member in members]
    chosen = [most_typical(values)] * len(members) if same else [most_typical([value]) for value in values]
    return Block(tuple(_line(member, world) for member in members), tuple(chosen))


def _line(behaviour: Behaviour, world: str) -> PolicyLine:
    return PolicyLine(behaviour.cell, behaviour.starts, behaviour.distances_mm[world])
