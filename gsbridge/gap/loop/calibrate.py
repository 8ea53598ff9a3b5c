"""Ordinary calibration of an arm's model: fits all standard parameters of an arm at once to its records.

The gap workflow names what a model *lacks*; it looks for one to three effects. A model with guessed parameters differs from
the arm in every gain, inertia and friction, which no set of three effects explains. So an arm is calibrated once, while it
works properly, and later changes are named relative to that calibrated model.

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
"""Parameters of each joint that are fitted; the delay of all commands is fitted, too."""

_FLOORS = {"stiffness": 1.0, "damping": 0.1, "armature": 1e-3, "viscous": 1e-2, "coulomb": 1e-2}
"""Sizes below which a parameter is practically zero, SI units; they set the scale of the search."""

_DELAY = 0.005
"""Delay that is practically zero, s; it sets the scale of the search and the spacing of the delays that are tried first."""

_STEP = 1e-3
"""Relative step of the finite differences."""

_LONGEST = 0.4
"""Longest delay that is tried, s."""

_GRAIN = 0.01
"""Residual that counts as 1 in the fit, as a share of a channel's range."""

_TAIL = 3.0
"""Residual, in units of `_GRAIN`, beyond which the robust loss grows less than quadratically (saturated torque, contacts)."""


@dataclass(frozen=True)
class Calibration:
    """A calibrated arm.

    Args:
        figures: Fitted parameters, by the names in `FIGURES`, SI units. [N] each.
        deviations: Standard deviation of each parameter, widened if residuals are large. [N] each.
        delay: Delay of the commands, s.
        delay_deviation: Standard deviation of the delay, s.
        before: Root mean square residual of each record under the original model, in units of the noise, by role.
        after: Root mean square residual of each record under the calibrated model, in units of the noise, by role.
        floor: Residual of the calibrated model on held-out records, by kind of channel, SI units: the smallest noise under
            which the model would count as right. [N] each.
        runs: Number of simulations.
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
    """Fit the parameters of all joints, and the delay of the commands.

    Args:
        system: The arm's model; the search starts from its values.
        records: Records by role.
        held_out: Roles that are only judged, not fitted.
    """
    begin = time.perf_counter()
    delay = sum(effect.parameters["time"] for effect in system.effects if effect.name == "command_delay")
    kept = tuple(effect for effect in system.effects if effect.name != "command_delay")
    none = np.zeros(len(system.joints))
    # Set losses and armature to zero and add them as effects of full size, so that the fit can also lower them.
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
        # The model's structural error is far above the noise, so weight each channel by a share of its range instead.
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
    """Convert a vector of parameters and the delay to effects on the bare arm. [5 N + 1]."""
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
    """Return the size of the white noise that would cover the residuals at every time scale, by kind, SI units. [N] each.

    It is the largest root mean square, over block lengths and views, of block means times the root of the block length.
    """
    first = views[0]
    out = np.zeros(len(first.channels))
    for view in views:
        left = view.residual(effects) * view.sigma
        for scale in [scale for scale in SCALES if scale <= len(left)]:
            out = np.maximum(out, np.sqrt((block_means(left, scale) ** 2).mean(axis=0)))
    kinds = dict.fromkeys(kind for kind, _ in first.channels)
    return {kind: np.array([out[c] for c, (found, _) in enumerate(first.channels) if found == kind]) for kind in kinds}


def _misfit(views: Sequence[JointResiduals], effects: Sequence[Applied]) -> float:
    """Return the sum over views of a robust loss, which large residuals do not dominate."""
    return float(sum(np.sqrt(1.0 + (view.residual(effects) / _TAIL) ** 2).sum() for view in views))


def _size(view: JointResiduals, sigma: Array, effects: Sequence[Applied] = ()) -> float:
    """Return the root mean square residual of a record, in units of the noise `sigma` [C] (SI units), which the view keeps."""
    view.set_noise(sigma, view.records)
    return float(np.sqrt((view.residual(effects) ** 2).sum() / view.freedom))


def calibrated_model(content: Mapping[str, Any], calibration: Calibration) -> dict[str, Any]:
    """Return the content of a model file with the calibrated parameters in place of its own, and the delay as an effect."""
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
