"""Recompute figures from the rows in `benchmarks/evidence`, with pandas alone: `python benchmarks/recompute.py`."""

import json
import sys
from pathlib import Path

import pandas as pd

HERE = Path(__file__).parent
CELL = ["task", "pair", "renderer", "variant"]
SIX = {"small_cube+foam_pad", "bear+foam_pad"}  # not among the six cells of the paper's mean drop


def rows(area: str, kind: str) -> pd.DataFrame:
    """Rows of one kind behind an area; none where nothing was recorded."""
    path = HERE / "evidence" / area / f"{kind}.csv.gz"
    return pd.read_csv(path, low_memory=False) if path.is_file() else pd.DataFrame(columns=["file", "key", "value"])


def success(area: str) -> dict[str, float]:
    """Mean success and mean relative drop over cells, %: excess contact is a failure in simulation only."""
    trials = rows(area, "trials")
    if trials.empty:
        return {}
    trials[[*CELL, "world"]] = trials.file.str.split("/", expand=True)[[2, 3, 4, 5, 6]].to_numpy()
    trials["good"] = trials.success_tolerant.where(trials.world != "sim", trials.success)
    rate = trials.groupby([*CELL, "world", "pose_set"]).good.mean().mul(100).rename("rate").reset_index()
    rate = rate.merge(
        rate[rate.world == "sim"].drop(columns="world"), on=[*CELL, "pose_set"], how="left", suffixes=("", "_sim")
    )
    rate["drop"] = 100 * (1 - rate.rate / rate.rate_sim)
    out = {}
    for (world, poses, task, renderer), cells in rate[rate.variant == "default"].groupby(
        ["world", "pose_set", "task", "renderer"]
    ):
        name = f"{world}_{poses}"
        if renderer == "gs":
            out[f"{'grasp' if task == 'grasp' else 'place'}_{name}"] = cells.rate.mean()
        if world != "sim" and task == "grasp" and renderer == "gs":
            out[f"drop_eight_{name}"] = cells["drop"].mean()
            out[f"drop_six_{name}"] = cells[~cells.pair.isin(SIX)]["drop"].mean()
        if world != "sim" and renderer == "mesh":
            out[f"rl_sim_drop_{name}"] = cells["drop"].mean()
    return out


def reconstruction() -> dict[str, float]:
    """Errors of cameras, scale, masks and meshes over the scenes, and leads of bindings, dB."""
    scenes, out = rows("real2sim", "scenes").pivot(index="file", columns="key", values="value"), {}
    wanted = {"camera_error": "camera_mm_median", "scale_error": "scale_percent", "chamfer_visual": "visual_chamfer_mm"}
    for name, key in wanted.items():
        values = pd.to_numeric(scenes[key]).abs() if key in scenes else pd.Series(dtype=float)
        out |= {f"{name}_median": values.median(), f"{name}_max": values.max()} if len(values) else {}
    shown = rows("real2sim", "rendering")
    if not shown.empty:
        shown = shown[
            (shown.origin == "mirror") & (shown.split == "held_out") & (shown.region == "masked") & (shown.surface == "visual")
        ]
        psnr = shown.pivot_table(index=["kind", "scene", "seed"], columns="binding", values="psnr")
        lead = (psnr.soft - psnr.games).groupby(["kind", "scene"]).mean()
        out |= {"soft_minus_games_all_mean": lead.mean(), "soft_minus_games_objects_mean": lead["object"].mean()}
    return out


def gap() -> dict[str, float]:
    """Share of single effects of five units and more that were named rightly, and of false alarms among empty cases, %."""
    found = rows("gap", "tiers")
    found = found[found.key.str.startswith("methods.gsbridge.list.")]
    if found.empty:
        return {}
    found[["case", "what"]] = found.key.str.extract(r"list\.(\d+)\.(\w+)").to_numpy()
    cases = found.pivot(index=["file", "case"], columns="what", values="value").reset_index()
    plain = cases[(cases.kind == "single") & (pd.to_numeric(cases.units) >= 5)]
    out = {f"gap_named_right_{file.split('/')[2]}": 100 * (of.outcome == "right").mean() for file, of in plain.groupby("file")}
    return out | {"gap_false_alarm": 100 * (cases[cases.hidden.isna()].outcome == "false_alarm").mean()}


if __name__ == "__main__":
    wrong = 0
    for area, found in {
        "real2sim": reconstruction(),
        "policies": success("policies"),
        "worlds": success("worlds"),
        "gap": gap(),
    }.items():
        recorded = json.loads((HERE / "scores" / f"{area}.json").read_text(encoding="utf-8"))["figures"] if found else {}
        for name, value in found.items():
            told = recorded.get(name, {}).get("value")
            wrong += told is not None and abs(told - value) > 1e-3 * max(1.0, abs(told))
            print(f"{area:10} {name:32} recomputed {value:9.3f}, recorded {'nothing' if told is None else f'{told:9.3f}'}")
    sys.exit(f"{wrong} figures differ" if wrong else None)
