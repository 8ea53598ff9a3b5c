"""Figures that the paper prints, shown beside ours.

Source: RL-GSBridge, table "Our Soft Mesh Binding Method Compared with GaMeS" (label `tab:GSresult`). The paper measures
full frames of its own captures; its metric script reads the training views, and objects carry a painted background. So the
values show the order of magnitude and the gap between the bindings; they do not measure our scenes.

Success rates are from its tables `tab:RLcontrast`, `tab:testgrasp` and `tab:testpickplace`: 32 trials per cell and world, so
every rate is a count out of 32. The paper's second world is a real robot; ours is the mirror, unless the world is `robot`.
"""

from __future__ import annotations

from dataclasses import dataclass

from gsbridge.report.tables.result_paths import CellPaths


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
    """Look up the paper's values for a scene; None where it has none, and for real captures, which it does not show.

    Args:
        scene: Scene name, for example `banana`.
        binding: `soft` (the paper's "Ours") or `games`; others have no counterpart.
        origin: `mirror` or `real`.
    """
    return PAPER_RENDERING.get((scene, binding)) if origin == "mirror" else None


def scene_order(scene: str) -> tuple[int, str]:
    """Sort key: the paper's order first, then by name."""
    return (PAPER_ORDER.index(scene) if scene in PAPER_ORDER else len(PAPER_ORDER), scene)


PAPER_TRIALS = 32
"""Trials per cell and world in the paper."""


@dataclass(frozen=True)
class PaperSuccess:
    """Successes of the paper's 32 trials of one cell, in simulation and on its robot."""

    sim: int
    real: int

    def rate(self, world: str) -> float:
        """Success rate in the paper's simulation for `sim`, on its robot for every other world. 0..1."""
        return (self.sim if world == "sim" else self.real) / PAPER_TRIALS


PAPER_SUCCESS: dict[CellPaths, PaperSuccess] = {
    CellPaths("grasp", "small_cube", "foam_pad"): PaperSuccess(31, 31),
    CellPaths("grasp", "cake", "foam_pad"): PaperSuccess(32, 32),
    CellPaths("grasp", "banana", "foam_pad"): PaperSuccess(32, 30),
    CellPaths("grasp", "bear", "foam_pad"): PaperSuccess(28, 32),
    CellPaths("grasp", "small_cube", "tablecloth"): PaperSuccess(31, 28),
    CellPaths("grasp", "cake", "tablecloth"): PaperSuccess(32, 30),
    CellPaths("grasp", "banana", "tablecloth"): PaperSuccess(32, 31),
    CellPaths("grasp", "bear", "tablecloth"): PaperSuccess(28, 24),
    CellPaths("grasp", "small_cube", "foam_pad", "mesh"): PaperSuccess(31, 4),
    CellPaths("grasp", "bear", "foam_pad", "mesh"): PaperSuccess(30, 8),
    CellPaths("pick_and_place", "cake", "plate"): PaperSuccess(22, 23),
}
"""The paper's successes by cell; `mesh` is its RL-sim. It prints 23 of 32 truncated, as 71.87 %, and rounds the others."""

PAPER_GRASPS = tuple(cell for cell in PAPER_SUCCESS if cell.task == "grasp" and cell.renderer == "gs")
"""The eight grasp cells of RL-GSBridge."""

PAPER_SCENARIOS = tuple(
    cell for cell in PAPER_GRASPS if (cell.object, cell.background) not in {("small_cube", "foam_pad"), ("bear", "foam_pad")}
)
"""The six cells of `tab:testgrasp`, over which the paper takes its mean drop of 6.6 %; `tab:RLcontrast` has the others."""

PAPER_POSE_SETS = ("fixed", "unseen")
"""Sets of start poses that the paper's values are shown beside: the paper tried no start outside its training square."""

PAPER_SUCCESS_NOTE = (
    "Paper values: RL-GSBridge, 32 trials per cell, simulation and a real robot. Mirrored worlds are no robot: there the "
    "paper's value shows what it reached beyond its own simulation."
)
