"""Files of a case of the gap as its stages leave them, made up: one axis, or many channels."""

from pathlib import Path

import numpy as np

from gsbridge.files import write_json
from gsbridge.gap.joints.residual_map import GROUPS

COLUMNS = sum(len(names) for names in GROUPS.values())


def a_map(channels: tuple[str, ...], rows: np.ndarray, marked: np.ndarray) -> dict:
    """A map as `gsbridge.gap.joints.residual_map` records it."""
    groups = {name: list(names) for name, names in GROUPS.items()}
    return {"groups": groups, "channels": list(channels), "values": rows.tolist(), "marked": marked.tolist()}


def findings(verdict: str = "named", **changes) -> dict:
    """What a diagnosis of an axis says; without a finding where the verdict has none."""
    fitted = verdict in ("named", "ambiguous", "none_of_the_known")
    effect = {
        "name": "coulomb",
        "joint": "axis",
        "title": "Coulomb friction",
        "hook": "transmission",
        "parameters": {"torque": {"value": 0.42, "unit": "N m", "interval90": [0.39, 0.45]}},
        "confused_with": ["viscous", "backlash"],
        "tell_apart": "compare slow with fast constant speed",
    }
    rivals = [
        {"effects": ["coulomb:axis"], "behind": 0.0, "probability": 1.0, "closure": 0.99},
        {"effects": ["lag", "viscous:axis"], "behind": 5718.0, "probability": 0.0, "closure": -0.2},
    ]
    verify = {"before": 31.0, "after": 2.1, "closure": 0.93, "accepted": True, "channels": {}, "unit": "noise"}
    return {
        "status": "pass",
        "reasons": [],
        "sentence": "The model of joint 'axis' lacks Coulomb friction (torque 0.42 ± 0.03 N m); "
        "the gap falls from 31 to 2.1 times noise.",
        "verdict": verdict,
        "something_remains": False,
        "effects": [effect] if fitted else [],
        "amended": [{"name": "coulomb", "joint": "axis", "parameters": {"torque": 0.42}}] if verdict == "named" else [],
        "ambiguous": [["coulomb:axis"], ["lag", "viscous:axis"]] if verdict == "ambiguous" else [],
        "p_value": 0.005,
        "p_remaining": 0.3,
        "rivals": rivals if fitted else [],
        "select": {"before": 30.0, "after": 1.0, "unit": "noise"},
        "verify": verify if fitted else None,
        "noise_floor": {"position.axis": 2e-4},
        "unseen": ["warming:axis"],
        "simulations": {"bank": 241, "case": 61},
        "seconds": 12.5,
        "records": {"fit": "a" * 64, "select": "b" * 64, "verify": "c" * 64},
        "seed": 3,
        **changes,
    }


def write_case(folder: Path, found: dict, joints: tuple[str, ...] = ("axis",)) -> dict[str, Path]:
    """Write the files of a case; residuals are large before and small after, at forward motion of the first joint."""
    rng = np.random.default_rng(0)
    kinds = ("position", "velocity", "effort")
    channels = tuple(f"{kind}.{joint}" for kind in kinds for joint in joints)
    paths = {name: folder / f"{name}.json" for name in ("records", "comparison", "screen", "findings", "replays")}
    paths["series"] = folder / "replays.npz"
    about = {"samples": 300, "seconds": 2.99, "rate_hz": 100.0, "commands": ["command"], "measured": list(kinds), "quantum": {}}
    roles = ("fit", "select", "verify")
    records = {role: {"name": role, "digest": role[0] * 64, **about} for role in roles}
    head = {"status": found["status"], "reasons": found["reasons"], "versions": {"gsbridge": "0"}, "seed": None}
    write_json(
        paths["records"],
        {**head, "model": "model.yaml", "model_digest": "d" * 64, "mechanism_digest": "e" * 64, "joints": list(joints),
         "mode": "pd", "effects": None, "records": records, "case": "case.yaml"},
    )  # fmt: skip
    values = np.full((len(channels), COLUMNS), 1.0)
    values[0, 1] = 31.0
    values[-1, 0] = np.nan
    before = a_map(channels, values, values > 2)
    row = {
        "whole": 30.0,
        "channels": dict.fromkeys(channels, 1.0),
        "noise": dict.fromkeys(channels, 2e-4),
        "residual_map": before,
    }
    write_json(paths["comparison"], {**head, "unit": "noise", "records": dict.fromkeys(roles, row)})
    alike = [{"pair": ["coulomb:axis", "backlash:axis"], "cosine": 0.97}]
    screen = {
        **head,
        "candidates": ["coulomb:axis"],
        "unseen": ["warming:axis"],
        "signature_similarity": alike,
        "signatures": 3,
        "simulations": 9,
    }
    write_json(paths["screen"], screen)
    write_json(paths["findings"], found)
    quiet = np.full_like(values, 1.0)
    rows = {"before": 31.0, "after": 2.1, "channels": list(channels), "remains": a_map(channels, quiet, quiet > 2)}
    write_json(paths["replays"], {**head, "records": dict.fromkeys(roles, rows)})
    time = np.arange(300) / 100
    motion = np.stack([np.sin(time + k) for k in range(len(joints))], axis=1)
    series = {}
    for role in roles:
        series |= {f"{role}/time": time, f"{role}/sigma": np.full(len(channels), 2e-4)}
        series[f"{role}/before"] = rng.normal(0, 1, (300, len(channels)))
        series[f"{role}/before"][:, 0] *= 31
        series |= {f"{role}/position": motion, f"{role}/nominal_position": motion + 0.01}
        if found["effects"]:
            series[f"{role}/after"] = rng.normal(0, 1, (300, len(channels)))
            series[f"{role}/explained_position"] = motion + 0.001
    np.savez(paths["series"], **{name: array.astype(np.float32) for name, array in series.items()})
    return paths
