"""The rendering table for print: held-out quality of all bindings, and our values by the paper's protocol beside its own."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field

from gsbridge.report.tables.formats import Table
from gsbridge.report.tables.paper import PAPER_NOTE, SUSPECT_NOTE, SUSPECT_SCENE, scene_order
from gsbridge.report.tables.rendering_rows import differences, mean_by_scene, values
from gsbridge.report.tables.rows import Row, number

SHOWN_BINDINGS = ("games", "games_vertices", "soft", "refined", "unbound")
METRICS = ("psnr", "ssim", "lpips", "alpha_iou")


@dataclass(frozen=True)
class SceneLine:
    """Rendering quality of one scene in one split and region.

    Args:
        scene, kind, origin: Name, kind and origin of the scene.
        status: `pass` or `degraded`, the worst of its main runs.
        reasons: Why it is degraded.
        metrics: {binding: {metric: mean over the seeds, None where not measured}}.
        seeds: {binding: number of seeds}.
        gain: PSNR of soft less that of GaMeS, mean over the seeds that both have, dB; None where one is missing.
        gain_range: Smallest and largest such difference over the seeds, dB; None for fewer than two seeds.
        refined_gain: PSNR of refined less that of soft, likewise, dB.
        moving_gain: PSNR of soft less that of `games_vertices` (GaMeS with free vertices), likewise, dB.
        paper: {binding: {metric: value as printed}}.
        suspect: True where the paper's value is probably a slip.
        views: Number of views behind the means.
        ceiling: PSNR that a perfect model would reach given the film's own noise, dB; None where it is not known.
    """

    scene: str
    kind: str
    origin: str
    status: str
    reasons: tuple[str, ...]
    metrics: dict[str, dict[str, float | None]]
    seeds: dict[str, int]
    gain: float | None
    gain_range: tuple[float, float] | None
    refined_gain: float | None
    paper: dict[str, dict[str, str]] = field(default_factory=dict)
    suspect: bool = False
    views: int = 0
    ceiling: float | None = None
    moving_gain: float | None = None

    @property
    def paper_gain(self) -> float | None:
        """PSNR of soft less that of GaMeS in the paper, dB; None where the paper lacks one of them."""
        if "soft" not in self.paper or "games" not in self.paper:
            return None
        return float(self.paper["soft"]["psnr"]) - float(self.paper["games"]["psnr"])


def scene_lines(rows: Sequence[Row], *, split: str, region: str, surface: str = "visual") -> list[SceneLine]:
    """Make one line per scene.

    Args:
        rows: Rows of `rendering.csv`.
        split: `held_out` or `train`.
        region: `masked` or `full`.
        surface: Mesh that the splats are bound to: `visual` or `hull`.

    Returns:
        Lines sorted by mirror before real, objects before backgrounds, then the paper's order.
    """
    fixed = {"split": split, "region": region, "surface": surface}
    chosen = [row for row in rows if all(row[name] == wanted for name, wanted in fixed.items())]
    gains, refined = differences(chosen, "soft", "games"), differences(chosen, "refined", "soft")
    moving = differences(chosen, "soft", "games_vertices")
    means = {
        (binding, metric): mean_by_scene(values(chosen, metric, binding=binding))
        for binding in SHOWN_BINDINGS
        for metric in METRICS
    }
    scenes = {row["scene"]: row for row in chosen}
    lines = []
    for scene in sorted(scenes, key=lambda s: (scenes[s]["origin"] != "mirror", scenes[s]["kind"] != "object", scene_order(s))):
        mine = [row for row in chosen if row["scene"] == scene]
        found = list(gains.get(scene, {}).values())
        steps = list(refined.get(scene, {}).values())
        lines.append(
            SceneLine(
                scene=scene,
                kind=scenes[scene]["kind"],
                origin=scenes[scene]["origin"],
                status="degraded" if any(row["status"] == "degraded" for row in mine) else "pass",
                reasons=tuple(dict.fromkeys(row["reasons"] for row in mine if row["reasons"])),
                metrics={
                    binding: {metric: means[binding, metric].get(scene) for metric in METRICS}
                    for binding in SHOWN_BINDINGS
                    if any(row["binding"] == binding for row in mine)
                },
                seeds={binding: len({row["seed"] for row in mine if row["binding"] == binding}) for binding in SHOWN_BINDINGS},
                gain=statistics.fmean(found) if found else None,
                gain_range=(min(found), max(found)) if len(found) > 1 else None,
                refined_gain=statistics.fmean(steps) if steps else None,
                moving_gain=statistics.fmean(moving[scene].values()) if moving.get(scene) else None,
                paper=_paper(mine),
                suspect=scene == SUSPECT_SCENE and scenes[scene]["origin"] == "mirror",
                views=max((int(number(row["views"]) or 0) for row in mine), default=0),
                ceiling=next((number(row["ceiling_db"]) for row in mine if row["ceiling_db"]), None),
            )
        )
    return lines


def _paper(rows: Sequence[Row]) -> dict[str, dict[str, str]]:
    """The paper's values by binding, as text."""
    return {
        row["binding"]: {metric: row[f"paper_{metric}"] for metric in ("psnr", "ssim", "lpips")}
        for row in rows
        if row["paper_psnr"]
    }


def lpips_reasons(rows: Sequence[Row]) -> list[str]:
    """Why LPIPS cells are empty, each reason once."""
    return list(dict.fromkeys(row["lpips_reason"] for row in rows if row["lpips_reason"]))


def mean_gain(lines: Sequence[SceneLine]) -> float | None:
    """Mean PSNR gain of soft over GaMeS, over the scenes that have one, dB."""
    found = [line.gain for line in lines if line.gain is not None]
    return statistics.fmean(found) if found else None


NAMES = {"games": "GaMeS", "games_vertices": "GaMeS, free vertices", "soft": "soft", "refined": "refined", "unbound": "unbound"}
MARK = "†"
GAIN_NOTE = (
    "soft − GaMeS: same mesh, budget, learning rates, initialisation and seeds, offset frozen at 0 for GaMeS; mean over the "
    "seeds that both have, the range over the seeds in brackets."
)
MOVING_NOTE = "Free vertices: GaMeS whose training moves the mesh, too."
CEILING_NOTE = (
    "Noise ceiling: what the path tracer's own noise leaves of the PSNR of a perfect model, from two takes of one frame."
)
MASKED_NOTE = "Masked: pixels of the object's mask; for backgrounds, pixels whose ray hits the table mesh."


def decibel(value: float | None, signed: bool = False) -> str:
    """Format a number with two decimals and a true minus sign; None becomes a dash."""
    if value is None:
        return "–"
    return f"{value:+.2f}".replace("-", "−") if signed else f"{value:.2f}"


def gain_text(line: SceneLine) -> str:
    """Format the gain of soft over GaMeS, with its range over the seeds where there is one."""
    text = decibel(line.gain, signed=True)
    if line.gain_range is None:
        return text
    return f"{text} [{decibel(line.gain_range[0], signed=True)} … {decibel(line.gain_range[1], signed=True)}]"


def quality_table(
    rows: Sequence[Row], origin: str, *, title: str, split: str, surface: str = "visual", explained: bool = False
) -> Table | None:
    """Masked PSNR of all bindings, the gain of soft over GaMeS, SSIM and alpha IoU of soft; None without rows.

    Args:
        rows: Rows of `rendering.csv`.
        origin: `mirror` or `real`.
        title: Caption.
        split: `held_out` or `train`.
        surface: `visual` or `hull`.
        explained: Say below the table what its columns mean.
    """
    lines = [line for line in scene_lines(rows, split=split, region="masked", surface=surface) if line.origin == origin]
    if not lines:
        return None
    bindings = [binding for binding in SHOWN_BINDINGS if any(binding in line.metrics for line in lines)]
    with_paper = any(line.paper for line in lines)
    with_moving = any(line.moving_gain is not None for line in lines)
    with_ceiling = any(line.ceiling is not None for line in lines)
    columns = [
        "scene",
        *(NAMES[b] for b in bindings),
        "soft − GaMeS",
        *(["soft − GaMeS, free vertices"] if with_moving else []),
        *(["paper's gain"] if with_paper else []),
    ]
    columns += [*(["noise ceiling"] if with_ceiling else []), "soft SSIM", "alpha IoU", "views", "seeds", "status"]
    body, best = [], set()
    for index, line in enumerate(lines):
        psnrs = {b: line.metrics.get(b, {}).get("psnr") for b in bindings}
        bound = {b: value for b, value in psnrs.items() if value is not None and b != "unbound"}
        if bound:
            best.add((index, 1 + bindings.index(max(bound, key=bound.__getitem__))))
        soft = line.metrics.get("soft", {})
        paper = decibel(line.paper_gain, signed=True) + (MARK if line.suspect else "")
        body.append(
            (
                line.scene,
                *(decibel(psnrs[b]) for b in bindings),
                gain_text(line),
                *([decibel(line.moving_gain, signed=True)] if with_moving else []),
                *([paper] if with_paper else []),
                *([decibel(line.ceiling)] if with_ceiling else []),
                _three(soft.get("ssim")),
                _three(soft.get("alpha_iou")),
                str(line.views),
                str(max(line.seeds.values())),
                line.status,
            )
        )
    more = [*([MOVING_NOTE] if with_moving else []), *([CEILING_NOTE] if with_ceiling else [])]
    notes = [MASKED_NOTE, GAIN_NOTE, *more] if explained else []
    for kind, name in (("object", "objects"), ("background", "backgrounds")):
        mine = [line for line in lines if line.kind == kind and line.gain is not None]
        if len(mine) > 1:
            notes.append(f"Mean soft − GaMeS over the {name}: {decibel(mean_gain(mine), signed=True)} dB.")
    if any(line.suspect and line.paper for line in lines):
        notes.append(f"{MARK} {SUSPECT_NOTE}")
    return Table(title, tuple(columns), tuple(body), tuple(notes), frozenset(best), tuple(line.status for line in lines))


def paper_table(rows: Sequence[Row]) -> Table | None:
    """The paper's table with our values beside it: full frames of the training views; None without mirrored scenes."""
    lines = [line for line in scene_lines(rows, split="train", region="full") if line.origin == "mirror" and line.paper]
    if not lines:
        return None
    columns = ["scene"]
    for metric, arrow in (("PSNR", "↑"), ("SSIM", "↑"), ("LPIPS", "↓")):
        columns += [f"{metric}{arrow} soft", "paper", f"{metric}{arrow} GaMeS", "paper"]
    body = []
    for line in lines:
        cells = [line.scene + (MARK if line.suspect else "")]
        for metric in ("psnr", "ssim", "lpips"):
            for binding in ("soft", "games"):
                value = line.metrics.get(binding, {}).get(metric)
                cells += [decibel(value) if metric == "psnr" else _three(value), line.paper.get(binding, {}).get(metric, "–")]
        body.append(tuple(cells))
    notes = [PAPER_NOTE, *(f"LPIPS is empty: {reason}." for reason in lpips_reasons(rows))]
    if any(line.suspect for line in lines):
        notes.append(f"{MARK} {SUSPECT_NOTE}")
    title = "The paper's protocol: full frames of training views, our value beside the paper's"
    return Table(title, tuple(columns), tuple(body), tuple(notes), status=tuple(line.status for line in lines))


def _three(value: float | None) -> str:
    """Format a value with three decimals; None becomes a dash."""
    return "–" if value is None else f"{value:.3f}"


def rendering_tables(rows: Sequence[Row]) -> dict[str, list[Table]]:
    """All tables of the rendering rows: {`mirror`: […], `real`: […]}."""
    out: dict[str, list[Table]] = {"mirror": [], "real": []}
    for origin, tables in out.items():
        hull = "Bound to the visual hull (a poor mesh), held-out views: masked PSNR in dB"
        found = [
            quality_table(rows, origin, title="Held-out views: masked PSNR in dB", split="held_out", explained=True),
            quality_table(rows, origin, title="Training views: masked PSNR in dB", split="train"),
            quality_table(rows, origin, title=hull, split="held_out", surface="hull"),
            paper_table(rows) if origin == "mirror" else None,
        ]
        tables += [table for table in found if table is not None]
    return out
