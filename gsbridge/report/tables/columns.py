"""Columns of all tables of rows and their meanings, in one place; `docs/tables.md` lists them from here.

`make schema` runs this module in the folder of the project; a test fails if that was forgotten.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.report.tables import failures, rendering_rows, success_rows, timing, training

PAGE = Path("docs/tables.md")
TABLES: Mapping[str, Sequence[str]] = {
    "rendering": rendering_rows.COLUMNS,
    "success": success_rows.COLUMNS,
    "failures": failures.COLUMNS,
    "training": training.COLUMNS,
    "timing": timing.COLUMNS,
}
"""Columns of each table, by the table's name on the page."""

MEANINGS = {
    "task": "`grasp` or `pick_and_place`",
    "object": "scene of the object",
    "background": "scene of the table",
    "renderer": "what drew the pictures of the training: `gs` (splats), or a mesh",
    "variant": "way of learning, a name of `variants` in `config.yaml`",
    "world": "where it was tried: `sim`, a mirror, or `robot`",
    "pose_set": "set of start poses: `fixed`, `unseen`, `outside`",
    "seeds": "number of trainings whose trials count together",
    "trials": "number of trials",
    "successes": "trials that succeeded; excess contact is a failure in simulation only",
    "success_rate": "successes / trials, 0 to 1",
    "ci95_low": "lower end of the rate's 95 % interval",
    "ci95_high": "upper end of it",
    "successes_tolerant": "successes where excess contact is forgiven everywhere",
    "successes_strict": "successes where it is forgiven nowhere",
    "relative_change": "(rate − rate in simulation) / rate in simulation; empty in simulation",
    "fisher_p": "Fisher's exact test, two-sided, that both worlds have one rate",
    "sim_successes": "successes in simulation from the same start poses, which both are compared with; empty in simulation",
    "sim_trials": "trials of that; fewer than all where not all start poses were tried",
    "paper_success_rate": "the paper's rate of that cell, 0 to 1; empty where it has none",
    "by_training": "successes/trials of each training",
    "status": "`pass` or `degraded`",
    "reasons": "why it is degraded, separated by `; `",
    "outcome": "how the trials ended, in a word; `none` for a success",
    "count": "trials that ended so",
    **{f"quadrant_{number}": f"of them with a start in quadrant {number}" for number in (1, 2, 3, 4)},
    "scene": "name of the scene",
    "kind": "`object` or `background`",
    "binding": "how splats hang on the mesh: `games`, `games_vertices`, `soft`, `refined`, or `unbound`",
    "split": "`train`, or `held_out`: photos that no training saw",
    "region": "`masked`: the object's pixels, or those whose ray meets the table's mesh; `full`: whole photos",
    "views": "number of photos",
    "psnr": "peak signal to noise ratio, dB, mean over the photos; higher is better",
    "ssim": "structural similarity, 0 to 1, 1 is best",
    "lpips": "learned perceptual distance, 0 is best; empty without weights",
    "alpha_iou": "overlap of drawn and true outline, 0 to 1",
    "splats": "number of splats",
    "seed": "seed of the training",
    "paper_psnr": "the paper's value, dB",
    "paper_ssim": "the paper's value",
    "paper_lpips": "the paper's value",
    "origin": "`mirror` or `real`: where the photos come from",
    "surface": "mesh that the splats hang on: `visual`, or `hull`, that of the outlines",
    "main": "`true` for the scene's own splats, `false` for trainings made for comparison alone",
    "lpips_reason": "why LPIPS is empty",
    "ceiling_db": "PSNR that the film's own noise leaves a perfect model, dB",
    "steps": "environment steps of the training",
    "best_success": "success in the evaluation that chose the weights, 0 to 1",
    "retest_success": "success of the same weights from other random starts",
    "controller_success": "success of the baseline controller",
    "cpu_environment_min": "processor time in the environment, pictures included, min",
    "cpu_act_min": "processor time of deciding, min",
    "cpu_update_min": "processor time of learning, min",
    "cpu_evaluate_min": "processor time of evaluations, min",
    "cpu_min": "sum of these, min",
    "steps_to_95": "steps until the first evaluation with 95 % success; empty where none had",
    "cpu_min_to_95": "processor time until then, min",
    "replay_mb": "memory of past steps, MB",
    "frames_per_second": "environment steps per second while acting and learning",
    "rule": "name of the rule",
    "item": "what the job was about",
    "wall_s": "time on the clock, s",
    "cpu_s": "processor time, s",
    "max_rss_mb": "largest memory, MB",
}
"""Meaning of each column; a name means the same in every table."""

_BLOCK = re.compile(r"<!-- columns: (\w+) -->\n.*?<!-- end -->\n", re.DOTALL)


def filled(page: str) -> str:
    """List the columns of table NAME in every block between `<!-- columns: NAME -->` and `<!-- end -->` of a page.

    Args:
        page: Markdown.

    Raises:
        InputError: There is no table NAME.
    """
    return _BLOCK.sub(lambda found: f"<!-- columns: {found[1]} -->\n\n{listed(found[1])}\n<!-- end -->\n", page)


def listed(name: str) -> str:
    """List the columns of a table and their meanings as a Markdown table."""
    if name not in TABLES:
        raise InputError(PAGE, f"there is no table '{name}'", f"Use one of {', '.join(TABLES)}")
    return "| column | meaning |\n|---|---|\n" + "".join(f"| `{column}` | {MEANINGS[column]} |\n" for column in TABLES[name])


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
