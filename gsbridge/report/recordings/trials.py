"""Recording of a policy's trials, failures first: pictures, paths, actions and forces of all worlds, trial after trial."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gsbridge.asset.bundle import read_asset
from gsbridge.geometry import Array
from gsbridge.report.figures.paired_trials import SIM, STEP_S, ShownTrials, Start, Tried, cell_name, failures_first, read_starts
from gsbridge.report.recordings.recording import log_centres, log_scene_axes, recording
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.tasks.episode import FORCES

ACTIONS = ("x", "y", "z", "turn", "opening")
AXES = [[220, 50, 50], [50, 180, 50], [60, 90, 230], [230, 160, 40], [150, 90, 200]]
FORCE_COLOURS = [[220, 50, 50], [60, 90, 230], [40, 40, 40], [230, 160, 40]]
WORLD_COLOURS = [[36, 102, 168], [217, 100, 30], [44, 122, 75], [150, 90, 200]]
"""Colours of the worlds in their order, simulation first."""
RUNNING, WON, LOST = [40, 40, 40], [44, 122, 75], [190, 44, 52]

PAUSE_S = 0.5
"""Pause between two trials on the timeline, s; curves have a gap there."""
WINDOW_S = 3.0
"""Length of the curves shown before and after the current time, s: about a trial."""
PAD_M, PALM_M = 0.02, 0.06
"""Half the width of the drawn pads and the height of the drawn palm over the tool point, m."""
EYE_M, TARGET_M = (0.55, -0.35, 0.50), (0.0, 0.26, 0.08)
"""Points where the viewer first stands and looks at; table frame, m. Objects start round x = 0, y = 0.265."""


def record_trials(
    cell: CellPaths, files: Sequence[ShownTrials], item: str | Path, background: str | Path, out: str | Path
) -> None:
    """Record all trials of one policy on the timelines `time` (s, one trial after the other) and `trial` (its number).

    Entities, for each world: `{world}/table/object` (transform) with `/centres`, `{world}/table/background/centres`,
    `{world}/table/hand` (lines), `{world}/table/paths/{other}` (the hand's path in each world), `{world}/picture`,
    `plots/actions/{world}` (5), `plots/forces/{world}` (4, N); `plots/apart` (mm between the hands of simulation and of each
    other world in the same step); `outcome`, `trials` (list), `paths/{number} {start} {outcome}/{world}` (all paths).

    Args:
        cell: What the policy learned.
        files: Trials of the policy, all worlds and seeds.
        item, background: `asset.json` of the object and of the background.
        out: The `.rrd`.

    Raises:
        InputError: A file is missing or damaged, or files do not belong together.
    """
    starts = failures_first(read_starts(files))
    worlds = list(starts[0].trials)
    clouds = {"object": read_asset(item).cloud(), "background": read_asset(background).cloud()}
    name = f"{cell.task}-{cell.object}+{cell.background}-{cell.renderer}-{cell.variant}"
    begins = np.cumsum([0.0, *(STEP_S * longest(start) + PAUSE_S for start in starts)])
    with recording(out, "trials", name, _layout(worlds)) as stream:
        log_scene_axes(stream, 0.1)
        log_centres(stream, "paths/background", clouds["background"])
        for world in worlds:
            for body, cloud in clouds.items():
                log_centres(stream, f"{world}/table/{body}/centres", cloud)
        _log_series(stream, worlds)
        stream.log("trials", rr.TextDocument(_list(cell, starts, begins), media_type="text/markdown"), static=True)
        for number, (start, begin) in enumerate(zip(starts, begins, strict=False)):
            _log_overview(stream, start, number)
            _log_trial(stream, start, number, float(begin))


def longest(start: Start) -> int:
    """Number of steps until the trial has ended in every world."""
    return max(len(trial.path) for trial in start.trials.values()) - 1


def hand_lines(position: Array, yaw: float, aperture: float) -> list[Array]:
    """The gripper as lines: pads, bars to the palm, palm. Table frame, m; the tool points down.

    Args:
        position: Tool point, between the pads, m. [3].
        yaw: Turn about the vertical, rad; the pads move across it.
        aperture: Distance of the pads, m.
    """
    along, across = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    palm = position + np.array([0.0, 0.0, PALM_M])
    left, right = position + 0.5 * aperture * across, position - 0.5 * aperture * across
    up = palm - position
    pads = [np.stack([pad - PAD_M * along, pad + PAD_M * along]) for pad in (left, right)]
    return [*pads, np.stack([left, left + up, right + up, right]), np.stack([palm, palm + 0.5 * up])]


def _layout(worlds: Sequence[str]) -> rrb.Container:
    """Space and outcome on the left; pictures above curves on the right."""
    eye = rrb.EyeControls3D(position=EYE_M, look_target=TARGET_M, eye_up=(0, 0, 1))
    views = [rrb.Spatial3DView(origin=f"{world}/table", name=_title(world), eye_controls=eye) for world in worlds]
    every = rrb.Spatial3DView(origin="paths", name="All paths", eye_controls=eye)
    pictures = [rrb.Spatial2DView(origin=f"{world}/picture", name=_title(world)) for world in worlds]
    window = rrb.VisibleTimeRange(
        "time",
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-WINDOW_S),
        end=rrb.TimeRangeBoundary.cursor_relative(seconds=WINDOW_S),
    )

    def curves(kind: str, title: str) -> list[rrb.TimeSeriesView]:
        return [
            rrb.TimeSeriesView(origin=f"plots/{kind}/{world}", name=f"{title}, {_title(world)}", time_ranges=window)
            for world in worlds
        ]

    texts = [rrb.TextDocumentView(origin=origin, name=origin.capitalize()) for origin in ("outcome", "trials")]
    plots: list[rrb.Horizontal | rrb.TimeSeriesView] = [
        rrb.Horizontal(*curves("actions", "Actions (-1 to 1)")),
        rrb.Horizontal(*curves("forces", "Contact forces (N)")),
    ]
    if len(worlds) > 1:
        plots.append(rrb.TimeSeriesView(origin="plots/apart", name="Hands apart in the same step (mm)", time_ranges=window))
    return rrb.Horizontal(
        rrb.Vertical(rrb.Tabs(rrb.Vertical(*views, name="Trial"), every), rrb.Tabs(*texts), row_shares=[5, 2]),
        rrb.Vertical(rrb.Horizontal(*pictures), *plots, row_shares=[4, 3, 3, 2][: 1 + len(plots)]),
        column_shares=[4, 5],
    )


def _log_series(stream: rr.RecordingStream, worlds: Sequence[str]) -> None:
    """Log the names and colours of the curves."""
    forces = [name.replace("_", " ") for name in FORCES]
    for world in worlds:
        stream.log(f"plots/actions/{world}", rr.SeriesLines(names=list(ACTIONS), colors=AXES), static=True)
        stream.log(f"plots/forces/{world}", rr.SeriesLines(names=forces, colors=FORCE_COLOURS), static=True)
    others = [(world, colour) for world, colour in zip(worlds, itertools.cycle(WORLD_COLOURS), strict=False) if world != SIM]
    if len(worlds) > 1:
        names, colours = zip(*others, strict=True)
        stream.log("plots/apart", rr.SeriesLines(names=[_title(world) for world in names], colors=list(colours)), static=True)


def _log_overview(stream: rr.RecordingStream, start: Start, number: int) -> None:
    """Log the hand's paths of one trial to the view of all paths, coloured by outcome."""
    outcome = "success" if start.succeeded() else "failure"
    for world, trial in start.trials.items():
        entity = f"paths/{rr.escape_entity_path_part(f'{number:03d} {start.label} {outcome}')}/{world}"
        colour = WON if trial.success else LOST
        stream.log(entity, rr.LineStrips3D([trial.hand], colors=[colour], radii=[0.0008]), static=True)


def _log_trial(stream: rr.RecordingStream, start: Start, number: int, begin: float) -> None:
    """Record one trial; a world that ends earlier stands still."""
    stream.set_time("trial", sequence=number)
    stream.set_time("time", duration=begin)
    stream.log("outcome", rr.TextDocument(_outcome(start, number), media_type="text/markdown"))
    for world, trial in start.trials.items():
        for (other, shown), colour in zip(start.trials.items(), itertools.cycle(WORLD_COLOURS), strict=False):
            strips = rr.LineStrips3D([shown.hand], colors=[colour], radii=[0.0012])
            stream.log(f"{world}/table/paths/{other}", strips)
        _log_world(stream, world, trial, number, begin)
    others = [world for world in start.trials if world != SIM]
    if SIM in start.trials and others:
        apart = np.full((longest(start) + 2, len(others)), np.nan)
        for column, world in enumerate(others):
            both = [np.asarray(start.trials[name].path.tool, dtype=np.float64) for name in (SIM, world)]
            count = min(map(len, both))
            apart[:count, column] = 1e3 * np.linalg.norm(both[0][:count] - both[1][:count], axis=1)
        _send_curves(stream, "plots/apart", apart, number, begin)


def _log_world(stream: rr.RecordingStream, world: str, trial: Tried, number: int, begin: float) -> None:
    """Log all states of one trial in one world, as columns: single rows would make the file several times as large."""
    path = trial.path
    count = len(path)
    index = _index(np.arange(count), number, begin)
    pictures = rr.EncodedImage.columns(blob=list(path.jpegs), media_type=["image/jpeg"] * count)
    stream.send_columns(f"{world}/picture", index, pictures)
    # A row without numbers breaks the curves between two trials; the last state has no action.
    gap = np.full((1, 1), np.nan)
    _send_curves(stream, f"plots/forces/{world}", np.r_[path.forces, gap.repeat(len(FORCES), 1)], number, begin)
    _send_curves(stream, f"plots/actions/{world}", np.r_[path.actions[:-1], gap.repeat(len(ACTIONS), 1)], number, begin)
    found = np.flatnonzero(np.isfinite(np.c_[path.object_position, path.object_quat]).all(axis=1))
    # rerun wants quaternions as xyzw.
    moved = rr.Transform3D.columns(translation=path.object_position[found], quaternion=path.object_quat[found][:, [1, 2, 3, 0]])
    stream.send_columns(f"{world}/table/object", _index(found, number, begin), moved)
    found = np.flatnonzero(np.isfinite(np.c_[path.tool, path.tool_yaw, path.aperture]).all(axis=1))
    hands = [hand_lines(path.tool[k], float(path.tool_yaw[k]), float(path.aperture[k])) for k in found]
    lines = len(hands[0])
    colours = np.array([[RUNNING, WON if trial.success else LOST][int(k == count - 1)] for k in found]).repeat(lines, axis=0)
    strips = rr.LineStrips3D.columns(
        strips=[line for hand in hands for line in hand], colors=colours, radii=np.full(len(colours), 0.003)
    )
    stream.send_columns(f"{world}/table/hand", _index(found, number, begin), strips.partition([lines] * len(found)))


def _index(steps: Array, number: int, begin: float) -> list[rr.TimeColumn]:
    """Make the columns of both timelines for some steps of a trial."""
    return [
        rr.TimeColumn("time", duration=begin + STEP_S * np.asarray(steps)),
        rr.TimeColumn("trial", sequence=np.full(len(steps), number)),
    ]


def _send_curves(stream: rr.RecordingStream, entity: str, values: Array, number: int, begin: float) -> None:
    """Log the values of all steps as curves. [N, C]."""
    columns = rr.Scalars.columns(scalars=np.ravel(values)).partition([values.shape[1]] * len(values))
    stream.send_columns(entity, _index(np.arange(len(values)), number, begin), columns)


def _outcome(start: Start, number: int) -> str:
    """Describe one trial in Markdown."""
    x, y, yaw = start.pose
    lines = [
        f"**Trial {number}: {start.label}**, quadrant {start.quadrant}, seed {start.seed}",
        "",
        f"- object at x {1e3 * x:.0f} mm, y {1e3 * y:.0f} mm, yaw {np.degrees(yaw):.0f} deg",
        *(f"- {_title(world)}: **{trial.outcome()}** after {trial.seconds:.2f} s" for world, trial in start.trials.items()),
    ]
    if SIM in start.trials:
        lines += [
            f"- paths of the hand, sim to {_title(world)}: {start.distance_mm(world):.1f} mm"
            for world in start.trials
            if world != SIM
        ]
    return "\n".join(lines)


def _list(cell: CellPaths, starts: Sequence[Start], begins: Array) -> str:
    """List all trials as a Markdown table."""
    worlds = list(starts[0].trials)
    wins = [f"{_title(world)} {sum(start.trials[world].success for start in starts)}" for world in worlds]
    lines = [
        f"**{cell.task.replace('_', ' ')}**: {cell_name(cell)}, {cell.renderer}, {cell.variant}",
        "",
        f"Successes of {len(starts)}: {', '.join(wins)}",
        "",
        f"| trial | time, s | start | quadrant | {' | '.join(map(_title, worlds))} |",
        "|" + "---|" * (4 + len(worlds)),
    ]
    for number, (start, begin) in enumerate(zip(starts, begins, strict=False)):
        outcomes = " | ".join(start.trials[world].outcome() for world in worlds)
        lines.append(f"| {number} | {begin:.1f} | {start.label} | {start.quadrant} | {outcomes} |")
    return "\n".join(lines)


def _title(world: str) -> str:
    return world.replace("_", " ")
