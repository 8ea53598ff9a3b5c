"""What splats are worth: success of policies that learned from splats and from meshes, against severity; and how well
simulation foretells which of several policies is the better one.

Columns of the rows of both, one for each training, world and set of start poses:

| column | content |
|---|---|
| `task`, `object`, `background` | what the policy does, and where |
| `renderer`, `variant`, `training` | what it saw as it learned, its way of learning, its seed |
| `world`, `look`, `physics` | where it was tried, and how severe that world is; empty for simulation |
| `pose_set` | `fixed`, `unseen` or `outside` |
| `trials`, `successes` | counts; excess contact is forgiven, as in every world but the simulated one |
| `status`, `reasons` | `degraded` where a scene, the policy or its trials are |
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from gsbridge.configuration.renderers import TITLES
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.report.tables.formats import Table, markdown
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.report.tables.rows import Row, read_rows, write_rows
from gsbridge.report.tables.statistics import (
    lead_interval,
    mean_interval,
    mean_maximum_rank_violation,
    mean_rate,
    pearson,
)
from gsbridge.report.tables.success_rows import CELL_COLUMNS, STRICT_WORLD, cell_in, read_trial_files
from gsbridge.statistics import Tally
from gsbridge.tasks.poses import POSE_SETS

COLUMNS = (*CELL_COLUMNS, *("training", "world", "look", "physics", "pose_set", "trials", "successes", "status", "reasons"))

INSIDE, OUTSIDE = ("fixed", "unseen"), ("outside",)
"""Sets of start poses inside the training square, which count together, and beyond it."""

CLAIM = 0.10
"""Lead of splats over the best mesh at equal variation of colours, severity 3, that the paper's claim needs: a share."""

Group = tuple[str, str, str]
"""Renderer, variant and world."""

Worlds = Mapping[str, tuple[str, str]]
"""Severity of look and of physics by the name of a world."""

Tallies = dict[Group, dict[tuple[str, str, str], list[Tally]]]
"""Successes and trials of each training, by group and by task, object and background."""


def write_severity_rows(
    out_csv: str | Path,
    trials: Sequence[str | Path],
    severities: Mapping[str, tuple[int, int]],
    *,
    policies: Sequence[str | Path] = (),
) -> None:
    """Write `rows/worth.csv` or `rows/graded.csv`.

    Args:
        out_csv: File to write.
        trials: Tables of trials, each beside its record.
        severities: Severity of look and of physics by the name of a world.
        policies: Records of the trainings.

    Raises:
        InputError: A file is missing or damaged, or no world is named.
    """
    if not severities:
        raise InputError("config: study.severity.worlds", "no world is named", "Name worlds of different severity")
    rows = []
    for file in read_trial_files(trials, policies=policies):
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
                        "reasons": "; ".join(file.reasons),
                    }
                )
    write_rows(out_csv, COLUMNS, rows)


def tallies_of(rows: Sequence[Row], pose_sets: Sequence[str] = INSIDE) -> Tallies:
    """Successes and trials of each training in some sets of start poses.

    Args:
        rows: Rows of `write_severity_rows`.
        pose_sets: Names of the sets, whose trials count together.
    """
    counts: dict[tuple[Group, tuple[str, str, str], str], list[int]] = {}
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


def write_worth_page(rows_csv: str | Path, page: str | Path) -> None:
    """Write the deciding table: success by renderer, variant and severity, and what splats lead by.

    Args:
        rows_csv: `rows/worth.csv`.
        page: Markdown.

    Raises:
        InputError: The rows are damaged, or there are none.
    """
    rows = _read(rows_csv)
    worlds, inside = worlds_of(rows), tallies_of(rows)
    found = [_success_table(inside, worlds, "Start poses inside the training square"), _lead_table(inside, worlds)]
    if outside := tallies_of(rows, OUTSIDE):
        found.append(_success_table(outside, worlds, "Start poses outside the training square"))
    found += _cell_tables(inside, worlds)
    lines = [
        "# What is it worth to learn from splats?",
        "",
        _QUESTION,
        "",
        verdict(inside, worlds),
        "",
        *map(markdown, found),
        _ABOUT,
        *_doubts(rows),
    ]
    with atomic_file(page) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


_QUESTION = (
    "Policies that learned from pictures drawn with splats, beside policies that learned the same from drawn meshes; all are "
    "tried in mirrors, path-traced stand-ins for reality. Severity, 0 to 4, is how bad a day the mirror has: light, gloss, "
    "clutter, camera, friction, latency. A cell of a table is the share of trials that succeed, its 95 % interval, and the "
    "counts behind it."
)

_FORETELLS = (
    "r: Pearson's correlation of the policies' success in simulation and there, 1 is best. MMRV: mean maximum rank violation, "
    "by how much policies that simulation puts behind others are better there, 0 is best. Severity, 0 to 4: how bad a day the "
    "mirror has.",
    "Both sets of start poses inside the training square. SIMPLER reports r 0.911 and MMRV 0.053, SimFoundry 0.911 and 0.018, "
    "on real robots. They say something only where success spreads in both worlds.",
)

_ABOUT = (
    "Means over the cells, each counting the same; 95 % intervals of a hierarchical bootstrap over trainings, then starts, or "
    "Wilson's where there is one training. All policies of a cell start from the same poses. A lead's two sides have the same "
    "variation of colours and the same shadows, and differ in what drew the pictures of the training."
)


def verdict(tallies: Tallies, worlds: Worlds) -> str:
    """Whether splats lead the best mesh by more than the paper's claim needs at severity 3, in a sentence or two."""
    tried = [world for world, severity in worlds.items() if severity == ("3", "3")]
    said = []
    for variant in _named(tallies, 1):
        splats = [tallies[key] for world in tried if (key := ("gs", variant, world)) in tallies]
        if not splats:
            continue
        meshes = [(name, tallies[name, variant, tried[0]]) for name in TITLES if (name, variant, tried[0]) in tallies]
        meshes = [(name, cells) for name, cells in meshes if not name.startswith("gs") and set(cells) == set(splats[0])]
        if not meshes:
            continue
        name, best = max(meshes, key=lambda item: mean_rate(item[1].values()))
        lead, (low, high) = (
            mean_rate(splats[0].values()) - mean_rate(best.values()),
            lead_interval(list(splats[0].values()), [best[place] for place in splats[0]]),
        )
        holds = "holds" if low > CLAIM else "does not hold" if high < CLAIM else "is not decided"
        said.append(
            f"{_way(variant)}, severity 3: splats lead the best mesh ({TITLES[name]}) by {points(lead)}"
            f" (95 % interval: {points(low).removesuffix(' points')} to {points(high)})."
            f" The paper's claim, more than {100 * CLAIM:.0f} points, **{holds}**."
        )
    return "\n\n".join(said) or "Nothing was tried at severity 3, so the paper's claim is not judged here."


def points(share: float) -> str:
    """A difference of shares in points, with a true minus sign."""
    return f"{100 * share:+.0f} points".replace("-", "−")


def _way(variant: str) -> str:
    return {"default": "With varied colours", "no_jitter": "Without varied colours"}.get(variant, variant)


def worlds_of(rows: Sequence[Row]) -> dict[str, tuple[str, str]]:
    """Severity of look and of physics of the worlds of the rows, kindest first; simulation is left aside."""
    found = {row["world"]: (row["look"], row["physics"]) for row in rows if row["world"] != STRICT_WORLD}
    return dict(sorted(found.items(), key=lambda item: (item[1], item[0])))


def _head(world: str, severity: tuple[str, str]) -> str:
    look, physics = severity
    return f"{world}, severity {look}" if look == physics else f"{world}, severity: look {look}, physics {physics}"


def _named(tallies: Tallies, part: int) -> list[str]:
    """Renderers (0) or variants (1) of the rows, in the order of their titles or of the rows."""
    found = list(dict.fromkeys(key[part] for key in tallies))
    return [name for name in TITLES if name in found] if part == 0 else found


def _lines(tallies: Tallies, worlds: Worlds, text: Callable[[Group], str]) -> tuple[tuple[str, ...], ...]:
    """A line for each renderer and variant with a cell for each world."""
    pairs = [(name, variant) for variant in _named(tallies, 1) for name in _named(tallies, 0)]
    kept = [pair for pair in pairs if any((*pair, world) in tallies for world in worlds)]
    return tuple((TITLES[name], _way(variant), *(text((name, variant, world)) for world in worlds)) for name, variant in kept)


def _success_table(tallies: Tallies, worlds: Worlds, title: str) -> Table:
    def text(group: Group) -> str:
        if group not in tallies:
            return ""
        low, high = mean_interval(tallies[group].values())
        every = [tally for cell in tallies[group].values() for tally in cell]
        counted = f"{sum(good for good, _ in every)}/{sum(tried for _, tried in every)}, {len(every)} trainings"
        return f"{100 * mean_rate(tallies[group].values()):.0f} % ({100 * low:.0f} to {100 * high:.0f}; {counted})"

    return Table(title, ("trained on", "colours", *(_head(*item) for item in worlds.items())), _lines(tallies, worlds, text))


def _lead_table(tallies: Tallies, worlds: Worlds) -> Table:
    first = _named(tallies, 0)[0]

    def text(group: Group) -> str:
        ours = tallies.get((first, *group[1:]), {})
        if group not in tallies or set(ours) != set(tallies[group]):
            return ""
        theirs = tallies[group]
        low, high = lead_interval(list(ours.values()), [theirs[place] for place in ours])
        lead = points(mean_rate(ours.values()) - mean_rate(theirs.values()))
        return f"{lead} ({100 * low:.0f} to {100 * high:.0f})".replace("-", "−")

    others = {group: cells for group, cells in tallies.items() if group[0] != first}
    columns = ("instead of", "colours", *(_head(*item) for item in worlds.items()))
    return Table(f"What {TITLES[first]} lead by", columns, _lines(others, worlds, text))


def _cell_tables(tallies: Tallies, worlds: Worlds) -> list[Table]:
    places = list(dict.fromkeys(place for cells in tallies.values() for place in cells))
    if len(places) == 1:
        return []
    own = [{group: {place: cells[place]} for group, cells in tallies.items() if place in cells} for place in places]
    titles = (f"{task}: {item} on {background}".replace("_", " ").capitalize() for task, item, background in places)
    return [_success_table(one, worlds, title) for one, title in zip(own, titles, strict=True)]


def _read(rows_csv: str | Path) -> list[Row]:
    rows = read_rows(rows_csv, COLUMNS)
    if not rows:
        raise InputError(rows_csv, "it holds no trials", "Delete the file and run the rule again")
    return rows


def _doubts(rows: Sequence[Row]) -> list[str]:
    """What degraded policies or trials are degraded for, each with how many trainings it concerns."""
    reasons: dict[str, set[tuple[CellPaths, str]]] = {}
    for row in rows:
        for reason in filter(None, row["reasons"].split("; ")):
            reasons.setdefault(reason, set()).add((cell_in(row), row["training"]))
    listed = [f"- {reason} ({len(found)} policies)" for reason, found in sorted(reasons.items())]
    return ["", "Degraded:", "", *listed] if listed else []


def write_graded_page(rows_csv: str | Path, page: str | Path) -> None:
    """Write how well simulation foretells each world: Pearson's r and MMRV over policies from poor to good.

    Args:
        rows_csv: `rows/graded.csv`.
        page: Markdown.

    Raises:
        InputError: The rows are damaged, or no policy was tried in simulation.
    """
    rows = _read(rows_csv)
    rates = graded_rates(rows)
    worlds = worlds_of(rows)
    if not any(STRICT_WORLD in found for found in rates.values()):
        raise InputError(rows_csv, "no policy was tried in simulation", "Delete the file and run the rule again")
    body = []
    for world, severity in worlds.items():
        pairs = [(found[STRICT_WORLD], found[world]) for found in rates.values() if STRICT_WORLD in found and world in found]
        sim, real = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
        r, violation = pearson(sim, real), mean_maximum_rank_violation(sim, real)
        shares = tuple(f"{100 * min(side):.0f} to {100 * max(side):.0f} %" for side in (sim, real))
        body.append(
            (
                *(_head(world, severity), str(len(pairs)), *shares),
                "–" if r is None else f"{r:.3f}",
                "–" if violation is None else f"{violation:.3f}",
            )
        )
    foretold = Table(
        "How well simulation foretells each world",
        ("world", "policies", "success in simulation", "success there", "r", "MMRV"),
        tuple(body),
        _FORETELLS,
    )
    columns = ("policy", "simulation", *(_head(*item) for item in worlds.items()))
    names = (STRICT_WORLD, *worlds)
    lines = tuple(
        (name, *(f"{100 * found[world]:.0f} %" if world in found else "" for world in names)) for name, found in rates.items()
    )
    parts = [markdown(foretold), markdown(Table("Success of each policy", columns, lines)), *_doubts(rows)]
    with atomic_file(page) as temporary:
        temporary.write_text(
            "\n".join(["# Policies from poor to good: does simulation foretell the mirror?", "", *parts]) + "\n",
            encoding="utf-8",
        )


def graded_rates(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Success by policy and world, inside the training square."""
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
