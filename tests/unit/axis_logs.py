"""Logs of a single axis, with effects hidden in them."""

import numpy as np
from scipy.signal import lfilter

from gsbridge.gap.benchmark.generate import _joined, draw_case
from gsbridge.gap.benchmark.mechanisms import axis_plant
from gsbridge.gap.benchmark.trajectories import course
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals

SEED, COURSES = 40, 41

SLOW = 2e-4
"""A model error of this size, rad, slower than any noise: the noise of a sample is as large, its mean over a second is not."""


def axis_in(folder):
    """The axis's model, its truth, and the folder that both lie in."""
    return (*axis_plant(folder), folder)


def records_of(axis, names=(), units=0.0, error=0.0, seed=SEED, **options):
    """Records of an axis; with a slow error of the model on the positions, another in each."""
    records = dict(draw_case(axis[1], names, units, seed, COURSES, **options).records)
    rng = np.random.default_rng(seed)
    for role, record in records.items():
        drift = lfilter([np.sqrt(1 - 0.99**2)], [1, -0.99], rng.standard_normal((len(record.time) + 500, 1)), axis=0)[500:]
        measured = dict(record.measured)
        measured["position"] = measured["position"] + error * drift
        records[role] = record.with_measured(measured)
    return records


def simulated(axis, records, effects, seed=SEED):
    """The same records as if the model with some effects had moved, with white noise."""
    out, rng = {}, np.random.default_rng(seed)
    for role, record in records.items():
        outputs = JointResiduals.of(Mechanism(axis[0]), record).simulate(effects)
        noise = axis[1].noise
        out[role] = record.with_measured(
            {kind: outputs[kind] + noise[kind] * rng.standard_normal(outputs[kind].shape) for kind in record.measured}
        )
    return out


def axis_course(duration=1.0):
    """Commands for the axis, and the times of samples at 100 Hz, s."""
    wanted = course("multisine", np.array([0.3]), np.array([0.9]), duration, np.random.default_rng(3))
    return _joined(wanted, 100.0), np.arange(round(100 * duration)) / 100
