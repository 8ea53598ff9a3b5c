"""What the rendering table says to a person: one line per scene, bindings side by side, the paper's values beside ours."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field

from gsbridge.report.tables.paper import SUSPECT_SCENE, scene_order
from gsbridge.report.tables.rendering_rows import differences, mean_by_scene, values
from gsbridge.report.tables.rows import Row, number

SHOWN_BINDINGS = ("games", "soft", "refined", "unbound")
METRICS = ("psnr", "ssim", "lpips", "alpha_iou")


@dataclass(frozen=True)
class SceneLine:
    """One scene in one split and region.

    Args:
        scene, kind, origin: Which scene.
        status: `pass` or `degraded`, the worst of its main runs.
        reasons: Why it is degraded.
        metrics: {binding: {metric: mean over the seeds, None where not measured}}.
        seeds: {binding: number of seeds}.
        gain: soft - GaMeS, mean over the seeds that both have, dB; None where one is missing.
        gain_range: Smallest and largest such difference over the seeds, where there are several.
        refined_gain: refined - soft likewise, dB.
        paper: {binding: {metric: value as printed}}.
        suspect: True where the paper's value is probably a slip.
        views: Number of views behind the means.
        ceiling: What the film's own noise leaves of the PSNR, dB; None where it is not known.
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

    @property
    def paper_gain(self) -> float | None:
        """The paper's own soft - GaMeS, dB."""
        if "soft" not in self.paper or "games" not in self.paper:
            return None
        return float(self.paper["soft"]["psnr"]) - float(self.paper["games"]["psnr"])


def scene_lines(rows: Sequence[Row], *, split: str, region: str, surface: str = "visual") -> list[SceneLine]:
    """One line per scene.

    Args:
        rows: Rows of `rendering.csv`.
        split: `held_out` or `train`.
        region: `masked` or `full`.
        surface: Mesh that the splats are bound to: `visual` or `hull`.

    Returns:
        Mirror before real, objects before backgrounds, the paper's order.
    """
    fixed = {"split": split, "region": region, "surface": surface}
    chosen = [row for row in rows if all(row[name] == wanted for name, wanted in fixed.items())]
    gains, refined = differences(chosen, "soft", "games"), differences(chosen, "refined", "soft")
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
    """Mean of soft - GaMeS over the scenes that have it, dB."""
    found = [line.gain for line in lines if line.gain is not None]
    return statistics.fmean(found) if found else None
