"""Pages on what splats are worth, and on how well simulation foretells which policy is the better one.

The first shows the success of policies that learned from splats and from meshes, against severity; the second compares policies
from poor to good. Their rows come from `severity_rows`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gsbridge.configuration.renderers import TITLES
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.report.tables.formats import Table, markdown
from gsbridge.report.tables.severity_rows import (
    OUTSIDE,
    Group,
    Lead,
    Tallies,
    Worlds,
    by_severity,
    doubts,
    graded_pairs,
    graded_rates,
    lead_over_best_mesh,
    read_severity_rows,
    resting,
    tallies_of,
    worlds_of,
)
from gsbridge.report.tables.statistics import mean_interval, mean_maximum_rank_violation, mean_rate, pearson
from gsbridge.report.tables.success_rows import STRICT_WORLD

CLAIM = 0.10
"""Lead of splats over the best mesh that the paper's claim needs, at severity 3 and equal variation of colours: a share."""

ONE_COLOUR = "mesh_shaded"
"""Renderer of the mesh in one colour, in the same shadows as splats."""

TELLING = 0.30
"""Lead of splats over `ONE_COLOUR`, without varied colours, from which a mirror counts as telling them apart: a share."""

WAYS = {"default": "With varied colours", "no_jitter": "Without varied colours"}
"""Titles of the variants on the pages."""


def write_worth_page(rows_csv: str | Path, page: str | Path) -> None:
    """Write the page on what splats are worth: success by renderer, variant and severity, and the leads of splats.

    Args:
        rows_csv: `rows/worth.csv`.
        page: Markdown.

    Raises:
        InputError: The rows are damaged, or there are none.
    """
    rows = read_severity_rows(rows_csv)
    worlds, inside, graded = worlds_of(rows), tallies_of(rows), tallies_of(by_severity(rows))
    found = [_success_table(inside, worlds, "Start poses inside the training square"), _lead_table(inside, worlds)]
    if outside := tallies_of(rows, OUTSIDE):
        found.append(_success_table(outside, worlds, "Start poses outside the training square"))
    found += _cell_tables(inside, worlds)
    lines = [
        "# What is it worth to learn from splats?",
        "",
        _QUESTION,
        "",
        verdict(graded),
        "",
        *(line for level in ("1", "2") for said in discrimination(graded, level) for line in (said, "")),
        resting(rows),
        "",
        *map(markdown, found),
        _ABOUT,
        *doubts(rows),
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
    "Means over the cells, each counting the same; 95 % intervals, the widest of a hierarchical bootstrap's over trainings, "
    "then starts, Student's of the trainings' rates, and Wilson's of as many trials. All policies of a cell start from the "
    "same poses. A lead's two sides have the same variation of colours and the same shadows, and differ in what drew the "
    "pictures of the training."
)


def verdict(tallies: Tallies) -> str:
    """State for each variant whether splats lead the best mesh by more than the paper's claim needs at severity 3.

    Args:
        tallies: Successes and trials by renderer, variant and severity.
    """
    said = []
    for variant in _named(tallies, 1):
        if found := lead_over_best_mesh(tallies, variant, "3"):
            name, lead = found
            low, high = lead.interval
            holds = "holds" if low > CLAIM else "does not hold" if high < CLAIM else "is not decided"
            said.append(
                f"{_way(variant)}, severity 3: splats lead the best mesh ({TITLES[name]}) by {_with_limits(lead)}."
                f" The paper's claim, more than {100 * CLAIM:.0f} points, **{holds}**."
            )
    return "\n\n".join(said) or "Nothing was tried at severity 3, so the paper's claim is not judged here."


def discrimination(tallies: Tallies, level: str) -> list[str]:
    """State whether a mirror tells splats from a mesh in one colour, both without varied colours, and why not if it does not.

    Args:
        tallies: Successes and trials by renderer, variant and severity.
        level: Severity.

    Returns:
        One item with the sentences; empty where the two share no cell.
    """
    ours, theirs = (tallies.get((name, "no_jitter", level), {}) for name in ("gs", ONE_COLOUR))
    lead = Lead.over_common_cells(ours, theirs)
    if lead is None:
        return []
    splats, mesh = mean_rate(lead.ours.values()), mean_rate(lead.theirs.values())
    if lead.value >= TELLING:
        judged = "The mirror **tells** them apart"
    else:
        both = "succeed more often than they fail, so it is too kind"
        if splats + mesh <= 1.0:
            both = "fail more often than they succeed, so the splats are too poor for it"
        judged = f"The mirror **does not tell** them apart: taken together both {both}"
    return [
        f"{_way('no_jitter')}, severity {level}: splats {100 * splats:.0f} %, the mesh in one colour {100 * mesh:.0f} %: a "
        f"lead of {_with_limits(lead)}. {judged} ({100 * TELLING:.0f} points are asked for)."
    ]


def points(share: float) -> str:
    """A difference of shares in points, with a true minus sign."""
    return f"{100 * share:+.0f} points".replace("-", "−")


def _with_limits(lead: Lead) -> str:
    low, high = lead.interval
    return f"{points(lead.value)} (95 % interval: {points(low).removesuffix(' points')} to {points(high)})"


def _way(variant: str) -> str:
    return WAYS.get(variant, variant)


def _head(world: str, severity: tuple[str, str]) -> str:
    look, physics = severity
    return f"{world}, severity {look}" if look == physics else f"{world}, severity: look {look}, physics {physics}"


def _named(tallies: Tallies, part: int) -> list[str]:
    """List the renderers (`part` 0) in the order of their titles, or the variants (`part` 1) in the order of the rows."""
    found = list(dict.fromkeys(key[part] for key in tallies))
    return [name for name in TITLES if name in found] if part == 0 else found


def _lines(tallies: Tallies, worlds: Worlds, text: Callable[[Group], str]) -> tuple[tuple[str, ...], ...]:
    """Make a line for each variant and renderer, with a cell for each world."""
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
        lead = Lead(ours, {place: tallies[group][place] for place in ours})
        low, high = lead.interval
        return f"{points(lead.value)} ({100 * low:.0f} to {100 * high:.0f})".replace("-", "−")

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


def write_graded_page(rows_csv: str | Path, page: str | Path) -> None:
    """Write how well simulation foretells each world: Pearson's r and MMRV over policies from poor to good.

    Args:
        rows_csv: `rows/graded.csv`.
        page: Markdown.

    Raises:
        InputError: The rows are damaged, or no policy was tried in simulation.
    """
    rows = read_severity_rows(rows_csv)
    rates = graded_rates(rows)
    worlds = worlds_of(rows)
    if not any(STRICT_WORLD in found for found in rates.values()):
        raise InputError(rows_csv, "no policy was tried in simulation", "Delete the file and run the rule again")
    body = []
    for world, severity in worlds.items():
        sim, real = graded_pairs(rates, world)
        r, violation = pearson(sim, real), mean_maximum_rank_violation(sim, real)
        shares = tuple(f"{100 * min(side):.0f} to {100 * max(side):.0f} %" if side else "–" for side in (sim, real))
        body.append(
            (
                *(_head(world, severity), str(len(sim)), *shares),
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
    parts = [resting(rows), "", markdown(foretold), markdown(Table("Success of each policy", columns, lines)), *doubts(rows)]
    with atomic_file(page) as temporary:
        temporary.write_text(
            "\n".join(["# Policies from poor to good: does simulation foretell the mirror?", "", *parts]) + "\n",
            encoding="utf-8",
        )
