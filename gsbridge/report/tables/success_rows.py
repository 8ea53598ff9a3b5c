"""Rows of the success tables: one per cell, world and set of start poses; the trials of all seeds together."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.configuration.renderers import RENDERERS
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.geometry import Array
from gsbridge.report.tables.paper import PAPER_POSE_SETS, PAPER_SUCCESS
from gsbridge.report.tables.result_paths import CellPaths, cell_of, seed_of
from gsbridge.report.tables.rows import Row, read_rows, write_rows
from gsbridge.report.tables.stages import degraded_reasons, read_records
from gsbridge.report.tables.statistics import fisher_p, mean_interval, relative_change
from gsbridge.statistics import Tally
from gsbridge.tasks.outcome import Failure
from gsbridge.tasks.poses import PER_QUADRANT, POSE_SETS, POSES, QUADRANTS

REQUIRED = ("pose_set", "index", "success")
TRIAL_COLUMNS = (
    *("pose_set", "index", "quadrant", "x", "y", "yaw"),
    *("success", "success_tolerant", "failure", "steps", "clipped", "refused"),
)
"""Columns of a policy's table of trials; trials on a robot need the `REQUIRED` ones only."""

STRICT_WORLD = "sim"
"""The world in which excess contact is a failure. Source: RL-GSBridge, experiments (pick and place)."""

_WORDS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}
_REMEDY = "Write one row per trial below the header `pose_set,index,success`"
_SAVE = "Save the table as comma-separated values in UTF-8"


@dataclass(frozen=True)
class Trials:
    """Trials of one policy in one world.

    Args:
        pose_set: `fixed`, `unseen` or `outside`. str [N].
        index: Number of the start pose in its set, 0 to 31. int [N].
        quadrant: Quadrant of the start pose, 1 to 4. int [N].
        success: Success by all rules of the task. bool [N].
        success_tolerant: Success if excess contact is forgiven. bool [N].
        failure: Word of `Failure`; `none` for a success, empty where no reason was recorded. str [N].
    """

    pose_set: Array
    index: Array
    quadrant: Array
    success: Array
    success_tolerant: Array
    failure: Array

    def __len__(self) -> int:
        return len(self.index)

    def of(self, pose_set: str) -> Trials:
        """Trials from one set of start poses."""
        rows = self.pose_set == pose_set
        return Trials(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def starting_at(self, indices: Collection[int]) -> Trials:
        """Trials from start poses with these numbers."""
        rows = np.isin(self.index, list(indices))
        return Trials(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def judged(self, world: str) -> Array:
        """Successes as the paper counts them: excess contact is a failure in simulation only. bool [N]."""
        return self.success if world == STRICT_WORLD else self.success_tolerant


def read_trials(path: str | Path) -> Trials:
    """Read the trials of one policy in one world.

    Args:
        path: CSV with the columns `TRIAL_COLUMNS`, or with `REQUIRED` alone; further columns are ignored. Yes and no may be
            written as true and false, 1 and 0, or yes and no. A missing `success_tolerant` equals `success`; a missing
            `quadrant` follows from the pose's index.

    Raises:
        InputError: The file is no comma-separated text, a column is missing or stands twice, a value makes no sense, a start
            pose appears twice, or there is no trial.
    """
    rows = [{name.strip(): value.strip() for name, value in row.items()} for row in _rows_written_by_people(path)]
    if not rows:
        raise InputError(path, "there is no trial in it", _REMEDY)
    missing = [name for name in REQUIRED if name not in rows[0]]
    if missing:
        raise InputError(path, f"the columns {', '.join(missing)} are missing", _REMEDY)
    # The header is line 1, so the first trial stands on line 2.
    trials = [_trial(path, line, row) for line, row in enumerate(rows, 2)]
    counts = Counter((trial["pose_set"], trial["index"]) for trial in trials)
    twice = [f"{pose_set} {index}" for (pose_set, index), count in counts.items() if count > 1]
    if twice:
        shown = ", ".join(twice[:4]) + (f" and {len(twice) - 4} more" if len(twice) > 4 else "")
        raise InputError(path, f"start poses stand twice: {shown}", "Keep one trial of each start pose")
    return Trials(**{name: np.array([trial[name] for trial in trials]) for name in Trials.__dataclass_fields__})


def _rows_written_by_people(path: str | Path) -> list[Row]:
    """Read the rows of a table that people may have written: no rule makes such a file again, so none is to be deleted."""
    try:
        rows = read_rows(path)
    except InputError as error:
        raise InputError(path, error.problem, _SAVE) if Path(path).is_file() else error from error
    with Path(path).open(newline="", encoding="utf-8-sig") as stream:
        names = [name.strip() for name in next(csv.reader(stream), [])]
    if len(names) == 1 and (mark := next((mark for mark in (";", "\t") if mark in names[0]), None)):
        raise InputError(path, f"its columns are separated by {'semicolons' if mark == ';' else 'tabs'}", _SAVE)
    twice = sorted(name for name, count in Counter(names).items() if name and count > 1)
    if twice:
        raise InputError(path, f"more than one column is called {', '.join(twice)}", "Keep one column of each name")
    return rows


def _trial(path: str | Path, line: int, row: Row) -> dict[str, Any]:
    """Read and check one trial."""

    def wrong(name: str, remedy: str) -> InputError:
        return InputError(path, f"line {line}: {name} is {row.get(name, '')!r}", remedy)

    def whole(name: str, lowest: int, highest: int) -> int:
        try:
            value = float(row[name])
        except ValueError:
            value = math.nan
        if not (lowest <= value <= highest and value == int(value)):
            raise wrong(name, f"Give a whole number from {lowest} to {highest}")
        return int(value)

    def yes(name: str) -> bool:
        if row[name].lower() not in _WORDS:
            raise wrong(name, "Write true or false")
        return _WORDS[row[name].lower()]

    if row["pose_set"] not in POSE_SETS:
        raise wrong("pose_set", f"Use one of {', '.join(POSE_SETS)}")
    index, success = whole("index", 0, POSES - 1), yes("success")
    tolerant = yes("success_tolerant") if row.get("success_tolerant") else success
    if success and not tolerant:
        raise wrong("success_tolerant", "A success stays one when excess contact is forgiven")
    failure = row.get("failure", "")
    if failure not in ("", *Failure) or (success and failure not in ("", Failure.NONE)):
        raise wrong("failure", f"Use a word of {', '.join(Failure)}, and none for a success")
    return {
        "pose_set": row["pose_set"],
        "index": index,
        "quadrant": whole("quadrant", 1, len(QUADRANTS)) if row.get("quadrant") else QUADRANTS[index // PER_QUADRANT],
        "success": success,
        "success_tolerant": tolerant,
        # A failed trial that is marked `none` gives no reason.
        "failure": Failure.NONE.value if success else ("" if failure == Failure.NONE else failure),
    }


CELL_COLUMNS = ("task", "object", "background", "renderer", "variant")
COLUMNS = (
    *CELL_COLUMNS,
    *("world", "pose_set", "seeds", "trials", "successes", "success_rate", "ci95_low", "ci95_high", "successes_tolerant"),
    *("relative_change", "fisher_p", "paper_success_rate", "status"),
    *("successes_strict", "reasons", "by_training", "sim_successes", "sim_trials"),
)
"""Rates and changes are shares, not percent. `successes` are counted as the paper does: excess contact is a failure in
simulation only; `successes_tolerant` forgives it everywhere, `successes_strict` nowhere. `relative_change` and `fisher_p`
compare a world with simulation for the same cell and start poses, that is with `sim_successes` of `sim_trials`: fewer than all
trials in simulation where the world did not try all start poses. `by_training`: successes/trials of each, `31/32 30/32`."""

TASKS = ("grasp", "pick_and_place")
ROBOT = "robot"


@dataclass(frozen=True)
class ReadTrials:
    """Trials of one policy in one world.

    Args:
        cell: What the policy was trained for.
        world: `sim`, `mirror`, `mirror_2`, … or `robot`.
        seed: Seed of the training.
        trials: Outcome of each trial.
        reasons: Why the trials, the policy or its scenes are degraded.
    """

    cell: CellPaths
    world: str
    seed: int
    trials: Trials
    reasons: tuple[str, ...] = ()


def read_trial_files(
    paths: Sequence[str | Path],
    *,
    robot: Mapping[str, str | Path] | None = None,
    policies: Sequence[str | Path] = (),
    records: Sequence[str | Path] = (),
) -> list[ReadTrials]:
    """Read trials and the reasons why they are degraded.

    Args:
        paths: `trials/{cell}/{world}/seed{seed}.csv`, each beside its record `seed{seed}.json`.
        robot: The user's own trials on a robot, by `{task}/{object}+{background}/{renderer}/{variant}`; CSV without a record.
        policies: `policies/{cell}/seed{seed}/training.json`.
        records: Records of the stages that made the scenes; a scene that one of them marks as degraded stays degraded.

    Raises:
        InputError: A file is damaged, or its path does not tell its cell.
    """
    before = degraded_reasons(read_records(records))
    trained = {}
    for path in policies:
        cell, rest = cell_of(path, "policies")
        trained[cell, seed_of(rest[0], path)] = _reasons(path, "training")
    out = []
    for path in map(Path, paths):
        cell, rest = cell_of(path, "trials")
        if len(rest) != 2:
            raise InputError(path, "the world cannot be told from this path", "Keep it below <variant>/<world>/seed<seed>.csv")
        seed = seed_of(rest[1], path)
        own = trained.get((cell, seed), ())
        # A record of trials repeats the reasons of its policy; list each reason once.
        repeated = {reason.replace("training: ", "trials: policy: ", 1) for reason in own}
        reasons = (*own, *(reason for reason in _reasons(path.with_suffix(".json"), "trials") if reason not in repeated))
        out.append(ReadTrials(cell, rest[0], seed, read_trials(path), (*_scene_reasons(cell, before), *reasons)))
    for name, path in (robot or {}).items():
        cell, _ = cell_of(Path("trials", name, ROBOT, "seed0.csv"), "trials")
        every = [doubts for (other, _), doubts in trained.items() if other == cell]
        # The trials do not say which seed drove the robot, so the reasons of all seeds count.
        reasons = tuple(dict.fromkeys(reason for doubts in every for reason in doubts))
        out.append(ReadTrials(cell, ROBOT, 0, read_trials(path), (*_scene_reasons(cell, before), *reasons)))
    return out


def _reasons(path: str | Path, stage: str) -> tuple[str, ...]:
    """Read why a record is degraded, with the stage's name before each reason; a policy's record may have no status."""
    record = read_json(path)
    if record.get("status") != "degraded":
        return ()
    return tuple(f"{stage}: {reason}" for reason in record.get("reasons") or ["no reason is written down"])


def _scene_reasons(cell: CellPaths, before: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """List why a cell's two scenes are degraded."""
    return tuple(f"{scene}: {reason}" for scene in (cell.object, cell.background) for reason in before.get(scene, ()))


def success_rows(files: Sequence[ReadTrials]) -> list[dict[str, Any]]:
    """Make the rows of a success table; the trials of all seeds are pooled.

    Raises:
        InputError: A seed appears twice in a cell and world.
    """
    groups: dict[tuple[CellPaths, str], list[ReadTrials]] = {}
    for file in files:
        group = groups.setdefault((file.cell, file.world), [])
        if any(other.seed == file.seed for other in group):
            raise InputError(_name(file.cell), f"seed {file.seed} in {file.world} stands twice", "Name each file once")
        group.append(file)
    counts = {
        (cell, world, pose_set): counted
        for (cell, world), group in groups.items()
        for pose_set in POSE_SETS
        if (counted := _count(group, world, pose_set))["trials"]
    }
    rows = []
    for (cell, world, pose_set), counted in counts.items():
        paper = PAPER_SUCCESS.get(cell) if pose_set in PAPER_POSE_SETS else None
        low, high = mean_interval([counted["tallies"]])
        rate = counted["successes"] / counted["trials"]
        sim = (
            _same_starts(groups[cell, world], groups.get((cell, STRICT_WORLD), ()), pose_set) if world != STRICT_WORLD else None
        )
        reasons = dict.fromkeys(reason for file in groups[cell, world] for reason in file.reasons)
        rows.append(
            {
                **{name: getattr(cell, name) for name in CELL_COLUMNS},
                "world": world,
                "pose_set": pose_set,
                **{name: value for name, value in counted.items() if name != "tallies"},
                "success_rate": rate,
                "ci95_low": low,
                "ci95_high": high,
                "relative_change": sim and relative_change(sim[0] / sim[1], rate),
                "fisher_p": sim and _p(fisher_p(*sim, counted["successes"], counted["trials"])),
                "paper_success_rate": paper and paper.rate(world),
                "status": "degraded" if reasons else "pass",
                "reasons": "; ".join(reasons),
                "by_training": tallies_text(counted["tallies"]),
                "sim_successes": sim and sim[0],
                "sim_trials": sim and sim[1],
            }
        )
    return sorted(rows, key=row_order)


def tallies_text(tallies: Sequence[Tally]) -> str:
    """Format successes and trials of each training for the column `by_training`."""
    return " ".join(f"{good}/{tried}" for good, tried in tallies)


def tallies_in(text: str) -> tuple[Tally, ...]:
    """Parse the text that `tallies_text` writes."""
    return tuple((int(good), int(tried)) for good, tried in (part.split("/") for part in text.split()))


def _count(group: Sequence[ReadTrials], world: str, pose_set: str) -> dict[str, Any]:
    """Trials and successes of all seeds in one set of poses."""
    found = [trials for file in group if len(trials := file.trials.of(pose_set))]

    def total(values: Callable[[Trials], Any]) -> int:
        return int(sum(values(trials).sum() for trials in found))

    return {
        "tallies": [(int(trials.judged(world).sum()), len(trials)) for trials in found],
        "seeds": len(found),
        "trials": sum(map(len, found)),
        "successes": total(lambda trials: trials.judged(world)),
        "successes_tolerant": total(lambda trials: trials.success_tolerant),
        "successes_strict": total(lambda trials: trials.success),
    }


def _same_starts(group: Sequence[ReadTrials], sim: Sequence[ReadTrials], pose_set: str) -> Tally | None:
    """Successes and trials in simulation from those start poses of a set that another world tried, too; None for none."""
    tried = {int(number) for file in group for number in file.trials.of(pose_set).index}
    found = [file.trials.of(pose_set).starting_at(tried).judged(STRICT_WORLD) for file in sim]
    trials = sum(map(len, found))
    return (sum(int(good.sum()) for good in found), trials) if trials else None


def _p(value: float) -> str:
    """Format a p-value with significant digits, because a fixed number of decimals would lose small ones."""
    return f"{value:.4g}"


def _name(cell: CellPaths) -> str:
    """Name a cell as paths do."""
    return f"{cell.task}/{cell.object}+{cell.background}/{cell.renderer}/{cell.variant}"


def row_order(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """Sort key of rows with the columns of a cell: the paper's order; simulation, mirrors, robot; fixed poses first."""
    world = row.get("world", "")
    return (
        *cell_order(CellPaths(*(row[name] for name in CELL_COLUMNS))),
        world != STRICT_WORLD,
        world == ROBOT,
        world,
        POSE_SETS.index(row["pose_set"]) if "pose_set" in row else 0,
    )


def cell_order(cell: CellPaths) -> tuple[Any, ...]:
    """Sort key of cells: the paper's first and in its order, then by name; RL-sim after the splats of the same cell."""
    known = list(PAPER_SUCCESS)
    place = CellPaths(cell.task, cell.object, cell.background)
    return (
        _index(TASKS, cell.task),
        _index(known, place),
        (cell.background, cell.object),
        _index(RENDERERS, cell.renderer),
        cell.renderer,
        cell.variant != "default",
        cell.variant,
    )


def _index(known: Sequence[Any], value: Any) -> int:
    """Place of a value among known ones; unknown ones come last."""
    return known.index(value) if value in known else len(known)


def write_success_rows(out_csv: str | Path, paths: Sequence[str | Path], **more: Any) -> None:
    """Write `rows/grasping.csv`, `rows/renderer_contrast.csv` or `rows/pick_and_place.csv`.

    Args:
        out_csv: File to write.
        paths: Tables of trials, as `read_trial_files` takes them.
        **more: Further arguments of `read_trial_files`.
    """
    write_rows(out_csv, COLUMNS, success_rows(read_trial_files(paths, **more)))


def cell_in(row: Mapping[str, str]) -> CellPaths:
    """The cell of a row."""
    return CellPaths(*(row[name] for name in CELL_COLUMNS))


def cells_in(rows: Iterable[Mapping[str, str]]) -> list[CellPaths]:
    """The cells of rows, each once, in their order."""
    return list(dict.fromkeys(map(cell_in, rows)))
