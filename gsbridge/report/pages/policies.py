"""The part about policies on the page of tables: its rows, its summary in sentences, its films."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gsbridge.configuration.renderers import TITLES
from gsbridge.errors import InputError
from gsbridge.report.tables import failures as failures_table
from gsbridge.report.tables import success_rows as success_table
from gsbridge.report.tables import training as training_table
from gsbridge.report.tables.counts import Overview, overviews, read_counts
from gsbridge.report.tables.formats import Table
from gsbridge.report.tables.paper import PAPER_GRASPS, PAPER_POSE_SETS, PAPER_SCENARIOS
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import Row, read_rows
from gsbridge.report.tables.success import MIRROR, cell_title, paper_drop, paper_mean, percent, standard_cells, success_tables
from gsbridge.report.tables.success_rows import ROBOT, STRICT_WORLD, cell_in

SUCCESS = ("grasping", "renderer_contrast", "pick_and_place")
COLUMNS = {
    **dict.fromkeys(SUCCESS, success_table.COLUMNS),
    "failures": failures_table.COLUMNS,
    "training": training_table.COLUMNS,
}
NAMES = tuple(COLUMNS)
"""Names of the rows about policies, in the order of the page."""

FILM_KINDS = {".mp4": "video/mp4", ".webm": "video/webm", ".gif": "image/gif", ".webp": "image/webp", ".png": "image/png"}
WORLD_TITLES = {MIRROR: "in the mirror", ROBOT: "on the robot"}

PolicyRows = dict[str, list[Row]]


_PARTS = (
    (
        ("grasping", "Grasping", ("success_rates",)),
        "A cell is one policy: an object on a background, tried once from each start pose of a set, the same poses in both "
        "worlds. The fixed ones are the paper's protocol, the unseen ones lie between them, "
        "those outside lie beyond the square from which a training draws its starts; a training uses none of them.",
    ),
    (
        ("renderer_contrast", "Trained on splats or on a mesh", ()),
        "The paper's control, RL-sim: the same training on pictures of the mesh instead of splats, tried in the same worlds.",
    ),
    (("pick_and_place", "Pick and place", ()), "The object is picked up and set down on the plate."),
    (
        ("behaviour", "The same behaviour in both worlds", ("behaviour",)),
        "What the hand does, and what the wrist camera sees, when a policy starts from the same pose in both worlds.",
    ),
    (("failures", "Failures", ()), "How the trials ended that are no success, by the task's own judgement."),
    (("training", "Training", ("learning_curves",)), "Each policy's way to its success, and what it took."),
)
"""Of each part: name of its rows, title, beginnings of its pictures' names; introduction."""


@dataclass(frozen=True)
class Picture:
    """A figure inside the page; `title` is its alternative text, which screen readers read aloud."""

    name: str
    title: str
    caption: str
    data: str


@dataclass(frozen=True)
class Part:
    """A part of the page, with a heading of its own."""

    id: str
    title: str
    intro: str
    tables: tuple[Table, ...]
    pictures: tuple[Picture, ...]


@dataclass(frozen=True)
class Film:
    """A film inside the page; `moving` is true for a video, which needs a player."""

    title: str
    data: str
    moving: bool


def read_policy_rows(named: Mapping[str, Path]) -> PolicyRows:
    """Read those of the rows that are about policies, in the order of the page.

    Raises:
        InputError: Rows are damaged.
    """
    return {name: read_rows(named[name], COLUMNS[name]) for name in NAMES if name in named}


def policy_tables(rows: PolicyRows) -> dict[str, list[Table]]:
    """Make the printed tables, by the name of their rows."""
    out = success_tables({name: found for name, found in rows.items() if name in SUCCESS})
    for name, table in (("failures", failures_table.failures_table), ("training", training_table.training_table)):
        if name in rows:
            out[name] = [made for made in [table(rows[name])] if made is not None]
    return out


def policy_parts(printed: Mapping[str, Sequence[Table]], pictures: Sequence[Picture]) -> list[Part]:
    """Make the parts of the page that have something to show.

    Args:
        printed: Printed tables by the name of their rows.
        pictures: Each goes to the part that lists the beginning of its name; without such a part it is left out.
    """
    out = []
    for (name, title, beginnings), intro in _PARTS:
        drawn = tuple(item for item in pictures if beginnings and item.name.startswith(beginnings))
        tables = tuple(printed.get(name, ())) if name in NAMES else ()
        if drawn or tables:
            out.append(Part(name.replace("_", "-"), title, intro, tables, drawn))
    return out


def degraded_policies(rows: PolicyRows, scenes: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """List why cells are degraded, without the reasons of their scenes, which the page lists on their own.

    Args:
        rows: All rows about policies.
        scenes: Reasons of each scene.
    """
    known = {f"{scene}: {reason}" for scene, reasons in scenes.items() for reason in reasons}
    out: dict[str, list[str]] = {}
    for name in SUCCESS:
        for row in rows.get(name, []):
            found = [reason for reason in row["reasons"].split("; ") if reason and reason not in known]
            if not found:
                continue
            cell = cell_in(row)
            reasons = out.setdefault(
                f"{cell_title(cell)}, {cell.task.replace('_', ' ')}, {TITLES.get(cell.renderer, cell.renderer)}", []
            )
            for reason in found:
                # The reasons of a training hold in every world.
                text = reason if reason.startswith("training: ") else f"{row['world']}: {reason}"
                reasons += [] if text in reasons else [text]
    return out


def policy_headline(rows: PolicyRows) -> list[str]:
    """Summarise the success tables in sentences, from unseen start poses where there are some."""
    grasping = rows.get("grasping", [])
    cells = standard_cells(grasping, "grasp")
    views = _views(grasping, cells)
    out = []
    if STRICT_WORLD in views:
        out.append(_means("Grasping", cells, views))
    if MIRROR in views:
        out += _drops(cells, views[MIRROR])
    contrast = rows.get("renderer_contrast", [])
    meshes = standard_cells(contrast, "grasp", "mesh")
    if found := _views(contrast, meshes).get(MIRROR):
        drop, _ = found.drop()
        paper = paper_drop(meshes)
        beside = f" (the paper: {percent(paper)})" if paper is not None else ""
        if drop is not None:
            head = (
                f"Of policies that learned from a mesh of one colour instead of splats (RL-sim, {_cells(list(found.changes))})"
            )
            out.append(f"{head} the success rate {_falls(drop)} on the way to the mirror{beside}.")
    placing = rows.get("pick_and_place", [])
    cells = standard_cells(placing, "pick_and_place")
    views = _views(placing, cells)
    if STRICT_WORLD in views:
        out.append(_means("Pick and place", cells, views))
    return out


def _views(rows: Sequence[Row], cells: Sequence[CellPaths]) -> dict[str, Overview]:
    """Overview of each world, from unseen start poses where there are some; never from those outside the training square."""
    found = [view for view in overviews(read_counts(rows), cells) if view.pose_set in PAPER_POSE_SETS]
    chosen = found[-1].pose_set if found else ""
    return {view.world: view for view in found if view.pose_set == chosen}


def _means(task: str, cells: Sequence[CellPaths], views: Mapping[str, Overview]) -> str:
    """State the mean success in simulation and in the other worlds."""
    sim = views[STRICT_WORLD]
    parts = [f"{percent(sim.mean)} of the trials succeed in simulation"]
    for world, where in WORLD_TITLES.items():
        if world in views:
            parts.append(f"{percent(views[world].mean)} {where}")
    text = f"{task}, {_cells(list(sim.rates))}, {sim.pose_set} start poses: " + ", ".join(parts[:-1])
    text += (" and " if len(parts) > 1 else "") + parts[-1]
    ours, real = paper_mean(cells, STRICT_WORLD), paper_mean(cells, ROBOT)
    beside = "" if ours is None else f" (the paper: {percent(ours)} in simulation, {percent(real)} on its robot)"
    return f"{text}{beside}."


def _drops(cells: Sequence[CellPaths], mirror: Overview) -> list[str]:
    """State the mean relative drops from simulation to the mirror."""
    drop, count = mirror.drop()
    if drop is None:
        return []
    average = f" on average over {count} cells" if count > 1 else ""
    text = f"From simulation to the mirror the success rate {_falls(drop)}{average}"
    if set(PAPER_GRASPS) <= set(cells):
        six, _ = mirror.drop(PAPER_SCENARIOS)
        text += f"; over the paper's six scenario cells it {_falls(six or 0.0)} (the paper: drops of "
        text += f"{percent(paper_drop(PAPER_GRASPS))} and {percent(paper_drop())})"
    return [f"{text}."]


def _falls(drop: float) -> str:
    """State a drop in words: `drops by 3.1 %`, `rises by 1.0 %` or `stays the same`."""
    if abs(drop) < 5e-4:
        return "stays the same"
    return f"{'drops' if drop >= 0 else 'rises'} by {percent(abs(drop))}"


def _cells(cells: Sequence[CellPaths]) -> str:
    """State the number of cells, such as `8 cells`; name a single cell."""
    return cell_title(cells[0]) if len(cells) == 1 else f"{len(cells)} cells"


def film(title: str, path: str | Path) -> Film:
    """Encode a film as a data URI, so that the page stays one file.

    Raises:
        InputError: The film is missing or of another kind.
    """
    source = Path(path)
    kind = FILM_KINDS.get(source.suffix.lower())
    if kind is None:
        raise InputError(source, "this is no film for a page", f"Use one of {', '.join(FILM_KINDS)}")
    try:
        data = source.read_bytes()
    except OSError as error:
        raise InputError(source, "the film cannot be read", "Run the rule that makes it") from error
    return Film(title, f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}", kind.startswith("video"))
