"""Measured figures, and the generic way to score them against their floors."""

from __future__ import annotations

import statistics
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from scipy import stats

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.statistics import wilson_interval

DIRECTIONS = ("at_least", "at_most")
ANY_PRESET = "any"
_KEYS = {"what", "area", "floor", "direction", "unit", "preset", "where", "needs", "stretch"}
_REQUIRED = _KEYS - {"needs", "stretch"}

Figure = dict[str, Any]
"""A measured figure: `value`, `n` (how much is behind it), `interval` and what it means (`interval_of`), `where` (its file)."""


def single(
    value: float | None, n: int, where: str, interval: Sequence[float] | None = None, interval_of: str | None = None
) -> Figure:
    """Make a figure from one value.

    Args:
        value: The value; None where it could not be measured.
        n: How many measurements are behind it.
        where: File that it comes from.
        interval: Lower and upper limit; None for none.
        interval_of: What the interval means, in words.
    """
    told = {} if interval_of is None else {"interval_of": interval_of}
    return {"value": value, "n": n, "interval": interval and list(interval), **told, "where": where}


def success_rate(successes: int, trials: int, where: str, /, **more: Any) -> Figure:
    """Make the figure of a success rate in percent with Wilson's 95 % interval.

    Args:
        successes: Successful trials.
        trials: All trials.
        where: File that they come from.
        **more: Further entries of the figure.
    """
    interval = [100 * limit for limit in wilson_interval(successes, trials)]
    return {**single(100 * successes / trials, trials, where, interval, "95 % (Wilson)"), **more}


def over_scenes(by_scene: Mapping[str, float], summary: Callable[[list[float]], float], where: str, **more: Any) -> Figure:
    """Make one figure from a value per scene.

    Args:
        by_scene: Value of each scene.
        summary: `min`, `max`, `statistics.median` or `statistics.fmean`.
        where: File that the values come from.
        **more: Further entries of the figure.

    Returns:
        The figure; its interval is Student's 95 % interval of the mean for a mean over at least two scenes, and the range
        over the scenes otherwise.
    """
    found = list(by_scene.values())
    interval, meaning = [min(found), max(found)], "range over scenes"
    if summary is statistics.fmean and len(found) > 1:
        half = float(stats.t.ppf(0.975, len(found) - 1)) * statistics.stdev(found) / len(found) ** 0.5
        interval, meaning = [summary(found) - half, summary(found) + half], "95 % of the mean over scenes (Student)"
    return {
        "value": summary(found),
        "n": len(found),
        "interval": interval,
        "interval_of": meaning,
        "by_scene": dict(by_scene),
        "where": where,
        **more,
    }


def write_measured(
    out: str | Path,
    preset: str | None,
    gather: Callable[[], Mapping[str, Figure]],
    *,
    damaged: str,
    source: str | Path | None = None,
) -> None:
    """Write measured figures, an input of `write_scores`.

    Args:
        out: The JSON file.
        preset: Preset that ran, so that figures of several presets can be scored together.
        gather: Makes the figures.
        damaged: Subject and verb of the error message if `gather` fails, such as `rows of the study are`.
        source: File that the error message names; `out` if None.

    Raises:
        InputError: A file is damaged.
    """
    try:
        figures = gather()
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            out if source is None else source, f"{damaged} damaged ({error!r})", "Delete what it was made from and run again"
        ) from error
    write_json(out, {"preset": preset, "figures": figures})


def read_floors(path: str | Path) -> dict[str, dict[str, Any]]:
    """Read `floors.yaml`: {figure: {what, area, floor, direction, unit, preset, where, needs?, stretch?}}.

    `needs` gives the smallest counts behind a figure, for example `{n: 4, seeds: 3}`; `stretch` is a further, voluntary aim. A
    figure whose `floor` is null has a stretch aim only, and its value never makes it unmet. A figure whose `stretch` is null as
    well is only reported.

    Raises:
        InputError: The file is missing or an entry is malformed.
    """
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(path, "the file does not exist", "Check the path") from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(path, f"this is no YAML ({error})", "Correct it") from error
    if not isinstance(content, dict) or not content:
        raise InputError(path, "no figure is listed", "List figures as name: {floor, direction, unit, …}")
    for name, entry in content.items():
        keys = set(entry) if isinstance(entry, dict) else set()
        if keys - _KEYS or _REQUIRED - keys:
            wrong = sorted(keys - _KEYS) or sorted(_REQUIRED - keys)
            raise InputError(path, f"figure {name!r}: unknown or missing keys {', '.join(wrong)}", "Correct the entry")
        aims = [entry["floor"], entry.get("stretch")]
        numbers = [isinstance(aim, (int, float)) or aim is None for aim in aims]
        forgotten = entry["floor"] is None and "stretch" not in entry
        if entry["direction"] not in DIRECTIONS or not all(numbers) or forgotten:
            raise InputError(path, f"figure {name!r}: direction or floor is wrong", f"Use one of {', '.join(DIRECTIONS)}")
    return content


def reaches(value: float, floor: float, direction: str) -> bool:
    """True if `value` is on the good side of `floor`, or equal to it.

    Args:
        value: Measured value.
        floor: Value that is asked for.
        direction: `at_least` or `at_most`.
    """
    return value >= floor if direction == "at_least" else value <= floor


def score_figure(floor: Mapping[str, Any], measured: Mapping[str, Any] | None, preset: str) -> dict[str, Any]:
    """Score one figure for `scores/{area}.json`.

    Args:
        floor: Entry of `floors.yaml`.
        measured: {value, n, interval, …}, or None where nothing was measured.
        preset: Preset that the measurement ran with.

    Returns:
        {what, value, floor, direction, unit, n, interval, met, reason, where, preset, …}; `reason` says why a figure is
        unmet, and is empty for one that is met.
    """
    measured = measured or {}
    value = measured.get("value")
    reason = ""
    if value is None:
        reason = "not measured"
    elif floor["preset"] not in (ANY_PRESET, preset):
        reason = f"measured with preset {preset}, asked for preset {floor['preset']}"
    elif lacking := [
        f"{measured.get(name, 0)} of {count} {'scenes' if name == 'n' else name}"
        for name, count in floor.get("needs", {}).items()
        if measured.get(name, 0) < count
    ]:
        reason = f"measured on {' and '.join(lacking)} only"
    elif floor["floor"] is not None and not reaches(value, floor["floor"], floor["direction"]):
        reason = "outside the floor"
    stretch = floor.get("stretch")
    return {
        "what": floor["what"],
        "value": value,
        "floor": floor["floor"],
        "direction": floor["direction"],
        "unit": floor["unit"],
        "n": measured.get("n", 0),
        "seeds": measured.get("seeds"),
        "interval": measured.get("interval"),
        "interval_of": measured.get("interval_of"),
        "by_scene": measured.get("by_scene"),
        "beside": measured.get("beside"),
        "met": not reason,
        "reason": reason,
        "stretch": stretch,
        "stretch_met": None
        if stretch is None
        else bool(not reason and value is not None and reaches(value, stretch, floor["direction"])),
        "where": measured.get("where") or floor["where"],
        "preset": floor["preset"],
    }


def current_commit() -> str:
    """Commit of the code that runs, with `-dirty` for edits on top; `unknown` outside a git checkout."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        found = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return found.stdout.strip()


def read_measured(paths: Sequence[str | Path], preset: str) -> dict[str, dict[str, Any]]:
    """Read measured figures: {figure: {preset: {value, n, …}}}.

    Args:
        paths: Files `{"figures": {name: {value, n, interval, where}}}`, with `preset` beside `figures` where a file was
            measured with another preset than the others; a later file wins.
        preset: Preset of files that name none.

    Raises:
        InputError: A file is damaged.
    """
    out: dict[str, dict[str, Any]] = {}
    for path in paths:
        content = read_json(path)
        figures = content.get("figures")
        if not isinstance(figures, dict):
            raise InputError(path, "the file holds no measured figures", "Delete it and run the rule that makes it")
        for name, figure in figures.items():
            out.setdefault(name, {})[content.get("preset") or preset] = figure
    return out


def write_scores(
    floors: str | Path,
    measured_json: Sequence[str | Path],
    out: str | Path,
    *,
    area: str,
    preset: str,
    provenance: Mapping[str, Any],
) -> None:
    """Compare all figures of one area with their floors and write `scores/{area}.json`.

    The file is {`provenance`: {commit, code, settings, models}, `figures`: {figure: score}}.

    Args:
        floors: `benchmarks/floors.yaml`.
        measured_json: Measured figures, as in `read_measured`.
        out: The scores.
        area: Area of the figures to compare.
        preset: Preset that the measurement ran with.
        provenance: Digests of the code and the settings behind the figures, as `gsbridge.experiment.provenance` gives them.

    Raises:
        InputError: A file is damaged, or no floor belongs to the area.
    """
    wanted = {name: entry for name, entry in read_floors(floors).items() if entry["area"] == area}
    if not wanted:
        raise InputError(floors, f"no figure belongs to the area {area!r}", "Check the area's name")
    measured = read_measured(measured_json, preset)
    scores = {}
    for name, entry in wanted.items():
        found = measured.get(name, {})
        used = entry["preset"] if entry["preset"] in found else next(iter(found), preset)
        scores[name] = score_figure(entry, found.get(used), used)
    write_json(out, {"provenance": {"commit": current_commit(), **provenance}, "figures": scores})
