"""Ordinary calibration of an arm's model: the figures that everybody knows an arm to have, fitted all at once to its records.

What the gap workflow names is what a model *lacks*; it looks for one to three effects. A model that was only ever guessed
differs in every gain, inertia and friction, and no set of three explains that. So an arm is calibrated once, in the state in
which it works, and what changes later is named against that.

Source: Swevers et al., Dynamic model identification for industrial robots, IEEE Control Systems Magazine 27, 2007.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from gsbridge.effects.registry import Applied
from gsbridge.gap.diagnosis.closure import block_means
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.detect import SCALES
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals, share_noise
from gsbridge.geometry import Array

logger = logging.getLogger("gsbridge")

FIGURES = ("stiffness", "damping", "armature", "viscous", "coulomb")
"""Figures of each joint that are fitted; the delay of all commands is fitted, too."""

_FLOORS = {"stiffness": 1.0, "damping": 0.1, "armature": 1e-3, "viscous": 1e-2, "coulomb": 1e-2}
"""Sizes below which a figure is as good as zero; they scale the search, SI units."""

_DELAY = 0.005
"""Delay below which it is as good as zero, s; it scales the search."""

_STEP = 1e-3
"""Step of finite differences, in shares of a figure's scale."""

_LONGEST = 0.4
"""Longest delay, s."""

_GRAIN = 0.01
"""Weight of a channel: the share of its range that counts as one."""

_TAIL = 3.0
"""Residual, in these units, beyond which it counts less than its square: torques at their limit, contacts."""


@dataclass(frozen=True)
class Calibration:
    """A calibrated arm.

    Args:
        figures: Fitted figures, by name of `FIGURES`. [N] each.
        deviations: Standard deviation of each, residuals above the noise allowed for. [N] each.
        delay: Delay of the commands, s.
        delay_deviation: Standard deviation of the delay, s.
        before: Residual of each record under the model as it was, in units of the noise.
        after: Residual of each record under the calibrated model, in units of the noise.
        floor: What the calibrated model leaves on records that were not fitted, by kind and joint, SI: the smallest noise under
            which it would pass for right. [N] each.
        runs: Simulations.
        seconds: Time that the whole calibration took, s.
    """

    figures: Mapping[str, Array]
    deviations: Mapping[str, Array]
    delay: float
    delay_deviation: float
    before: Mapping[str, float]
    after: Mapping[str, float]
    floor: Mapping[str, Array]
    runs: int
    seconds: float


def calibrate(system: MechanismModel, records: Mapping[str, Record], held_out: Sequence[str] = ("verify",)) -> Calibration:
    """Fit all figures of all joints, and the delay of the commands.

    Args:
        system: The arm as its model has it; its gains are where the search starts.
        records: Records by role.
        held_out: Roles that are not fitted, only judged.
    """
    begin = time.perf_counter()
    delay = sum(effect.parameters["time"] for effect in system.effects if effect.name == "command_delay")
    kept = tuple(effect for effect in system.effects if effect.name != "command_delay")
    none = np.zeros(len(system.joints))
    # Losses and armature are effects with their whole size, so that they may also become smaller than the model says.
    bare = replace(system, viscous=none, coulomb=none, armature=none, effects=kept)
    given = {
        "stiffness": system.controller.stiffness,
        "damping": system.controller.damping,
        "armature": system.armature,
        "viscous": system.viscous,
        "coulomb": system.coulomb,
    }
    scale = np.concatenate([np.maximum(given[name], 10 * _FLOORS[name]) for name in FIGURES] + [np.array([_DELAY])])
    start = np.concatenate([np.maximum(given[name], _FLOORS[name]) for name in FIGURES] + [np.array([delay + _DELAY])])
    plain = Mechanism(system)
    views = {role: JointResiduals.of(Mechanism(bare), record, _effects(bare, start)) for role, record in records.items()}
    share_noise(tuple(views.values()))
    noise = {role: view.sigma for role, view in views.items()}
    before = {role: _size(JointResiduals.of(plain, record), noise[role]) for role, record in records.items()}
    fitted = [view for role, view in views.items() if role not in held_out]
    for view in fitted:
        # A model is no better than its structure: a hundredth of a channel's range counts as much as that of any other.
        view.set_noise(_GRAIN * np.ptp(view.stack(view.record.measured), axis=0), view.records)
    start[-1] = min(np.arange(0.0, _LONGEST, _DELAY), key=lambda time: _misfit(fitted, _effects(bare, np.r_[start[:-1], time])))
    logger.info("the search starts from a delay of %g s", start[-1])

    def residuals(scaled: Array) -> Array:
        effects = _effects(bare, scaled * scale)
        return np.concatenate([view.residual(effects).ravel() for view in fitted])

    upper = np.full(len(scale), np.inf)
    upper[-1] = _LONGEST / _DELAY
    found = least_squares(
        residuals, start / scale, bounds=(np.zeros(len(scale)), upper), x_scale="jac", diff_step=[_STEP], max_nfev=25,
        ftol=1e-5, xtol=1e-6, loss="soft_l1", f_scale=_TAIL,
    )  # fmt: skip
    vector = found.x * scale
    after = {role: _size(view, noise[role], _effects(bare, vector)) for role, view in views.items()}
    floor = _floor([views[role] for role in held_out], _effects(bare, vector))
    wide = max(1.0, float(np.sqrt(2 * found.cost / len(found.fun))))
    slope = np.asarray(found.jac)
    covariance = np.linalg.pinv(slope.T @ slope, rcond=1e-12)
    spread = wide * np.sqrt(np.maximum(np.diag(covariance), 0.0)) * scale
    count = len(system.joints)
    figures = {name: vector[k * count : (k + 1) * count] for k, name in enumerate(FIGURES)}
    deviations = {name: spread[k * count : (k + 1) * count] for k, name in enumerate(FIGURES)}
    runs = plain.runs + sum(view.mechanism.runs for view in views.values())
    logger.info("calibrated with %d simulations: %s", runs, after)
    return Calibration(
        figures, deviations, float(vector[-1]), float(spread[-1]), before, after, floor, runs, time.perf_counter() - begin
    )


def _effects(system: MechanismModel, vector: Array) -> tuple[Applied, ...]:
    """Figures as effects on the bare arm. [5 N + 1]."""
    count = len(system.joints)
    rows = {name: vector[k * count : (k + 1) * count] for k, name in enumerate(FIGURES)}
    out = [Applied("command_delay", "", {"time": float(vector[-1])})]
    for k, joint in enumerate(system.joints):
        out += [
            Applied("gain_p", joint, {"change": float(rows["stiffness"][k] / system.controller.stiffness[k] - 1.0)}),
            Applied("gain_d", joint, {"change": float(rows["damping"][k] / system.controller.damping[k] - 1.0)}),
            Applied("armature", joint, {"inertia": float(rows["armature"][k])}),
            Applied("viscous", joint, {"coefficient": float(rows["viscous"][k])}),
            Applied("coulomb", joint, {"torque": float(rows["coulomb"][k])}),
        ]
    return tuple(out)


def _floor(views: Sequence[JointResiduals], effects: Sequence[Applied]) -> dict[str, Array]:
    """Spread of means over blocks, of the length at which it is largest, times the root of the length: white noise of this
    size shows as much at every length of time. By kind, [N] each."""
    first = views[0]
    out = np.zeros(len(first.channels))
    for view in views:
        left = view.residual(effects) * view.sigma
        for scale in SCALES:
            out = np.maximum(out, np.sqrt((block_means(left, scale) ** 2).mean(axis=0)))
    kinds = dict.fromkeys(kind for kind, _ in first.channels)
    return {kind: np.array([out[c] for c, (found, _) in enumerate(first.channels) if found == kind]) for kind in kinds}


def _misfit(views: Sequence[JointResiduals], effects: Sequence[Applied]) -> float:
    """Sum over views of a loss that large residuals do not dominate."""
    return float(sum(np.sqrt(1.0 + (view.residual(effects) / _TAIL) ** 2).sum() for view in views))


def _size(view: JointResiduals, sigma: Array, effects: Sequence[Applied] = ()) -> float:
    """Residual of a record, in units of the noise."""
    view.set_noise(sigma, view.records)
    return float(np.sqrt((view.residual(effects) ** 2).sum() / view.freedom))


def calibrated_model(content: Mapping[str, Any], calibration: Calibration) -> dict[str, Any]:
    """Content of a model file with the calibrated figures in place of its own, and the delay as an effect."""
    out = dict(content)
    out["controller"] = {
        **content["controller"],
        "stiffness": [float(value) for value in calibration.figures["stiffness"]],
        "damping": [float(value) for value in calibration.figures["damping"]],
    }
    for name in ("armature", "viscous", "coulomb"):
        out[name] = [float(value) for value in calibration.figures[name]]
    others = [effect for effect in content.get("effects") or [] if effect["name"] != "command_delay"]
    out["effects"] = [{"name": "command_delay", "parameters": {"time": calibration.delay}}, *others]
    return out
