"""The rendering table for print: held-out quality of all bindings, and the paper's protocol beside the paper's values."""

from __future__ import annotations

from collections.abc import Sequence

from gsbridge.report.tables.formats import Table
from gsbridge.report.tables.paper import PAPER_NOTE, SUSPECT_NOTE
from gsbridge.report.tables.rendering_summary import SHOWN_BINDINGS, SceneLine, lpips_reasons, mean_gain, scene_lines
from gsbridge.report.tables.rows import Row

NAMES = {"games": "GaMeS", "soft": "soft", "refined": "refined", "unbound": "unbound"}
MARK = "†"
GAIN_NOTE = (
    "soft − GaMeS: same mesh, budget, learning rates, initialisation and seeds, offset frozen at 0 for GaMeS; mean over the "
    "seeds that both have, the range over the seeds in brackets."
)
CEILING_NOTE = (
    "Noise ceiling: what the path tracer's own noise leaves of the PSNR of a perfect model, from two takes of one frame."
)
MASKED_NOTE = "Masked: pixels of the object's mask; for backgrounds, pixels whose ray hits the table mesh."


def decibel(value: float | None, signed: bool = False) -> str:
    """Two decimals, a true minus sign; a dash for none."""
    if value is None:
        return "–"
    return f"{value:+.2f}".replace("-", "−") if signed else f"{value:.2f}"


def gain_text(line: SceneLine) -> str:
    """soft - GaMeS with its range over the seeds."""
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
    with_ceiling = any(line.ceiling is not None for line in lines)
    columns = [
        "scene",
        *(NAMES[b] for b in bindings),
        "soft − GaMeS",
        *(["paper's gain"] if with_paper else []),
    ]
    columns += [*(["noise ceiling"] if with_ceiling else []), "soft SSIM", "alpha IoU", "views × seeds", "status"]
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
                *([paper] if with_paper else []),
                *([decibel(line.ceiling)] if with_ceiling else []),
                _three(soft.get("ssim")),
                _three(soft.get("alpha_iou")),
                f"{line.views} × {max(line.seeds.values())}",
                line.status,
            )
        )
    notes = [MASKED_NOTE, GAIN_NOTE, *([CEILING_NOTE] if with_ceiling else [])] if explained else []
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
    """Three decimals, or a dash."""
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
