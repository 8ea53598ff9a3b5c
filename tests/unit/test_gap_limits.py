"""Limits that one record passes and another does not, and commands that a log lost."""

from dataclasses import replace

import numpy as np
import pytest
from axis_logs import axis_in, records_of, simulated

from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.candidates import JointCandidate
from gsbridge.gap.joints.diagnose import diagnose_joints, views_of
from gsbridge.gap.joints.identify import JointIdentification
from gsbridge.gap.joints.limits import levels, peaks_of
from gsbridge.gap.joints.mechanism.replay import Mechanism, with_lost_commands
from gsbridge.gap.joints.motion import is_motion, jolted
from gsbridge.gap.joints.residuals import JointResiduals

NAMES = ("saturation", "rate_limit", "coulomb", "viscous", "gain_p", "payload", "armature", "clock_drift")


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    return axis_in(tmp_path_factory.mktemp("axis"))


@pytest.fixture(scope="module")
def by_effort(axis):
    """Three records of the axis, the one that asks least of the motor first, and what each asks at most, N m."""
    mechanism = Mechanism(axis[0])
    peaks = {
        role: float(peaks_of(JointResiduals.of(mechanism, record), ())["effort"][0])
        for role, record in records_of(axis).items()
    }
    order = sorted(peaks, key=peaks.__getitem__)
    return [records_of(axis)[role] for role in order], [peaks[role] for role in order]


def limited(axis, by_effort, roles, others=()):
    """Records in which a limit hides that the gentlest of them does not reach, and that limit's parameter."""
    records, peaks = by_effort
    weakness = 1.0 / (0.3 * peaks[0] + 0.7 * peaks[1])
    hidden = JointCandidate("saturation", "axis").applied({"weakness": weakness})
    logs = dict(zip(roles, records, strict=True))
    return simulated(axis, {role: logs[role] for role in ("fit", "select", "verify")}, (hidden, *others)), weakness


def test_a_limit_that_the_fitted_record_does_not_reach_is_named(axis, by_effort):
    """All that it does is left of `select`; it is fitted there, and `verify` confirms it."""
    friction = JointCandidate("coulomb", "axis").applied({"torque": 0.3})
    logs, weakness = limited(axis, by_effort, ("fit", "verify", "select"), (friction,))
    found = diagnose_joints(axis[0], logs, axis[2] / "bank", names=NAMES, seed=1).finding
    assert found.verdict == "named"
    assert {str(who) for who in found.best.fit.who} == {"coulomb:axis", "saturation:axis"}
    sizes = dict(zip((who.name for who in found.best.fit.who), found.best.fit.values, strict=True))
    assert sizes["saturation"]["weakness"] == pytest.approx(weakness, rel=0.01)
    assert sizes["coulomb"]["torque"] == pytest.approx(0.3, rel=0.05)


def test_a_limit_alone_is_named_where_the_fitted_record_shows_nothing(axis, by_effort):
    logs, weakness = limited(axis, by_effort, ("fit", "verify", "select"))
    found = diagnose_joints(axis[0], logs, axis[2] / "bank", names=NAMES, seed=1).finding
    assert found.verdict == "named"
    assert found.best.names == ("saturation:axis",)
    assert found.best.fit.values[0]["weakness"] == pytest.approx(weakness, rel=0.01)


def test_a_limit_that_only_one_record_shows_is_not_named(axis, by_effort):
    """Where `verify` does not reach it either, nothing has tested it."""
    records, peaks = by_effort
    logs, _ = limited(axis, ((records[0], records[0], records[2]), peaks), ("fit", "verify", "select"))
    found = diagnose_joints(axis[0], logs, axis[2] / "bank", names=NAMES, seed=1).finding
    assert found.verdict != "named"


def test_nothing_is_looked_for_where_records_agree(axis, by_effort):
    records, _ = by_effort
    logs = simulated(axis, dict(zip(("fit", "verify", "select"), records, strict=True)), ())
    views = views_of(Mechanism(axis[0]), {role: logs[role] for role in ("fit", "select")})
    who = [JointCandidate(name, "axis") for name in ("saturation", "rate_limit")]
    search = JointIdentification(views["fit"], views["select"], signature_bank(views["fit"], who, axis[2] / "bank"), who)
    assert search.run().verdict == "no_discrepancy"
    assert not search.fits.late


def test_limits_are_looked_at_below_the_largest_value(axis, by_effort):
    records, peaks = by_effort
    mechanism = Mechanism(axis[0])
    views = [JointResiduals.of(mechanism, record) for record in records]
    tried = levels(views, (), JointCandidate("saturation", "axis"))
    assert 1.0 / np.array([values["weakness"] for values in tried]) == pytest.approx(
        max(peaks) * np.array([0.95, 0.88, 0.8, 0.7, 0.6, 0.5])
    )
    speeds = np.abs(np.diff(records[0].commands["command"], axis=0)[:, 0] / np.diff(records[0].time))
    assert peaks_of(views[0], ())["command_velocity"][0] == pytest.approx(speeds.max())


def wave(time):
    return Record("wave", time, ("axis",), {"command": 0.4 * np.sin(3.0 * time)[:, None]}, {})


def test_commands_that_a_log_lost_are_put_back():
    time = 0.01 * np.arange(400)
    kept = np.ones(400, bool)
    kept[[37, 111, 112, 300]] = False
    filled, commands = with_lost_commands(wave(time[kept]))
    assert filled == pytest.approx(time, abs=1e-12)
    assert commands["command"][:, 0] == pytest.approx(0.4 * np.sin(3.0 * time), abs=2e-7)


@pytest.mark.parametrize("kind", ["whole", "long", "jitters"])
def test_logs_that_lost_nothing_stay_as_they_are(kind):
    time = 0.01 * np.arange(400)
    if kind == "long":
        time = np.concatenate([time[:200], time[200:] + 1.0])
    if kind == "jitters":
        time = time + np.random.default_rng(0).uniform(-0.004, 0.004, 400)
    record = wave(time)
    filled, commands = with_lost_commands(record)
    assert filled is record.time
    assert commands is record.commands
    assert with_lost_commands(replace(record, commands={}))[1] == {}


def residuals_of(axis, jolts, seed):
    """Two records' views with noise as residuals, and a jolt of both channels, of one, or of none."""
    records, rng = records_of(axis), np.random.default_rng(seed)
    views = list(views_of(Mechanism(axis[0]), {role: records[role] for role in ("fit", "select")}).values())
    out = []
    for view in views:
        shape = (len(view.record.time), len(view.channels))
        noise = rng.standard_normal(shape)
        row = int(rng.integers(20, shape[0] - 20))
        for kind in jolts:
            noise[row, view.channels.index((kind, 0))] += 30.0
        out.append(noise)
    return views, out


@pytest.mark.parametrize(
    ("jolts", "seen"), [(("position", "velocity"), {0}), (("velocity",), set()), ((), set())], ids=["both", "one", "none"]
)
def test_a_moment_in_which_two_channels_err_by_far_is_motion(axis, jolts, seen):
    views, left = residuals_of(axis, jolts, 3)
    assert all(jolted(view, row) == seen for view, row in zip(views, left, strict=True))
    assert is_motion(views, left, np.random.default_rng(0), 3.0) == bool(seen)


def test_noise_with_outliers_is_no_motion(axis):
    """Student's t with five degrees of freedom, in all channels, on two records: one of 200 may show two outliers at once."""
    views, _ = residuals_of(axis, (), 0)
    rng = np.random.default_rng(1)
    shape = (len(views[0].record.time), len(views[0].channels))
    heavy = rng.standard_t(5, (200, *shape)) / np.sqrt(5 / 3)
    assert sum(bool(jolted(views[0], row)) for row in heavy) <= 2
