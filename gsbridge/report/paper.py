"""Figures that the paper prints, to stand beside ours.

Source: RL-GSBridge, table "Our Soft Mesh Binding Method Compared with GaMeS" (label `tab:GSresult`). The paper measures
full frames of its own captures; its metric script reads the training views, and objects carry a painted background. So the
values show the order of magnitude and the gap between the bindings, and are no measurement of our scenes.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PaperValues:
    """Rendering quality of one scene and binding: PSNR in dB (higher is better), SSIM (higher), LPIPS (lower)."""

    psnr: float
    ssim: float
    lpips: float


PAPER_RENDERING: dict[tuple[str, str], PaperValues] = {
    ("banana", "soft"): PaperValues(35.46, 0.989, 0.026),
    ("banana", "games"): PaperValues(26.53, 0.894, 0.049),
    ("bear", "soft"): PaperValues(29.82, 0.964, 0.034),
    ("bear", "games"): PaperValues(28.18, 0.956, 0.040),
    ("cake", "soft"): PaperValues(33.38, 0.975, 0.066),
    ("cake", "games"): PaperValues(30.73, 0.964, 0.079),
    ("small_cube", "soft"): PaperValues(37.18, 0.989, 0.012),
    ("small_cube", "games"): PaperValues(36.64, 0.989, 0.012),
    ("foam_pad", "soft"): PaperValues(28.40, 0.944, 0.144),
    ("foam_pad", "games"): PaperValues(27.32, 0.939, 0.149),
    ("tablecloth", "soft"): PaperValues(22.88, 0.781, 0.248),
    ("tablecloth", "games"): PaperValues(21.86, 0.776, 0.308),
    ("plate", "soft"): PaperValues(21.86, 0.776, 0.308),
    ("plate", "games"): PaperValues(20.80, 0.756, 0.311),
}
"""The paper's "Ours" is the binding `soft` here."""

PAPER_ORDER = ("banana", "bear", "cake", "small_cube", "foam_pad", "tablecloth", "plate")
"""Scenes in the order of the paper's table."""

SUSPECT_SCENE = "plate"
SUSPECT_NOTE = (
    'The paper\'s "Plate, ours" (21.86 dB, 0.776, 0.308) repeats its "Tablecloth, GaMeS" in all three metrics: '
    "probably a slip of copying, so treat the plate's paper value with care."
)

PAPER_NOTE = (
    "Paper values: RL-GSBridge, full frames of its own training views, objects over a painted background; "
    "they show the order of magnitude and the gap between the bindings, not the same photos."
)


def paper_values(scene: str, binding: str, origin: str) -> PaperValues | None:
    """The paper's values for a scene of the same name, or None: real captures of ours are none of the paper's scenes.

    Args:
        scene: Scene name, for example `banana`.
        binding: `soft` (the paper's "Ours") or `games`; others have no counterpart.
        origin: `mirror` or `real`.
    """
    return PAPER_RENDERING.get((scene, binding)) if origin == "mirror" else None


def scene_order(scene: str) -> tuple[int, str]:
    """Sort key: the paper's order first, then by name."""
    return (PAPER_ORDER.index(scene) if scene in PAPER_ORDER else len(PAPER_ORDER), scene)
