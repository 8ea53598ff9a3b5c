"""Limits that one record reaches and another does not, and commands that are missing in a log."""

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


def test_a_limit_that_verify_does_not_confirm_takes_no_name_from_the_rest(axis, by_effort):
    """Friction is in all three records, the limit is grazed in one: the friction is named, and that something remains."""
    records, _ = by_effort
    hidden = (
        JointCandidate("coulomb", "axis").applied({"torque": 0.3}),
        JointCandidate("saturation", "axis").applied({"weakness": 1.0 / 4.55}),
    )
    logs = simulated(axis, {"fit": records[0], "select": records[2], "verify": records[0]}, hidden)
    found = diagnose_joints(axis[0], logs, axis[2] / "bank", names=NAMES, seed=1).finding
    assert found.verdict == "named"
    assert found.best.names == ("coulomb:axis",)
    assert found.something_remains


def test_a_limit_is_found_beside_two_effects(axis, by_effort):
    """What `fit` shows is found first, even where `select`, whose errors a limit rules, likes another explanation better."""
    others = (
        JointCandidate("coulomb", "axis").applied({"torque": 0.3}),
        JointCandidate("viscous", "axis").applied({"coefficient": 0.05}),
    )
    logs, weakness = limited(axis, by_effort, ("fit", "verify", "select"), others)
    names = (*NAMES, "quadratic_drag", "lag", "damping")
    found = diagnose_joints(axis[0], logs, axis[2] / "bank", names=names, seed=1).finding
    assert found.verdict == "named"
    assert found.best.names == ("coulomb:axis", "saturation:axis", "viscous:axis")
    assert found.best.fit.records == 2
    sizes = dict(zip((who.name for who in found.best.fit.who), found.best.fit.values, strict=True))
    assert sizes["saturation"]["weakness"] == pytest.approx(weakness, rel=0.01)
    assert found.runs <= 90


def search_of(axis, logs, names, third=True):
    """A search among some effects of the axis."""
    views = views_of(Mechanism(axis[0]), {role: logs[role] for role in ("fit", "select", "verify")})
    who = [JointCandidate(name, "axis") for name in names]
    bank = signature_bank(views["fit"], who, axis[2] / "bank")
    return JointIdentification(views["fit"], views["select"], bank, who, third=views["verify"] if third else None)


def test_nothing_is_looked_for_where_records_agree(axis, by_effort):
    records, _ = by_effort
    logs = simulated(axis, dict(zip(("fit", "verify", "select"), records, strict=True)), ())
    search = search_of(axis, logs, ("saturation", "rate_limit"))
    assert search.run().verdict == "no_discrepancy"
    assert not search.fits.late


def test_no_limit_is_looked_for_where_no_third_record_could_confirm_it(axis, by_effort):
    logs, _ = limited(axis, by_effort, ("fit", "verify", "select"))
    search = search_of(axis, logs, ("saturation", "rate_limit"), third=False)
    assert search.run().verdict == "none_of_the_known"
    assert not search.fits.late


def test_fits_to_two_records_keep_to_the_budget(axis, by_effort):
    """Each derivative takes a simulation of both: a fit that could not end in time is not begun."""
    logs, weakness = limited(axis, by_effort, ("fit", "verify", "select"))
    search = search_of(axis, logs, ("saturation", "viscous"))
    mechanism = search.first.mechanism
    limit = mechanism.runs + 9
    found = search.fits.fit(search.who, [{"weakness": 1.3 * weakness}, {"coefficient": 0.1}], limit=limit, both=True)
    assert not found.converged
    # The start and its derivatives come first, in any case.
    assert mechanism.runs <= limit + 2


def test_the_error_of_parameters_knows_both_records(axis, by_effort):
    """A fit to two records is surer of itself than one to the first, on which a limit shows nothing."""
    logs, weakness = limited(axis, by_effort, ("fit", "verify", "select"))
    search = search_of(axis, logs, ("saturation",))
    one, both = (search.fits.fit(search.who, [{"weakness": weakness}], both=both) for both in (False, True))
    assert (one.records, both.records) == (1, 2)
    assert np.isinf(one.deviations).all()
    assert 0.0 < both.deviations[0] < 1e-3 * weakness
    assert search.trial_of(both).score == pytest.approx(search.trial_of(both).squares + 3.0)


def test_a_limit_is_sought_below_what_a_resting_joint_shows(axis):
    """A joint that holds still on `fit` has a largest speed of zero there, and a limit of it is looked for all the same."""
    records = records_of(axis)
    still = records["fit"].commands["command"].copy()
    still[:] = still[0]
    logs = dict(records, fit=replace(records["fit"], commands={"command": still}))
    slow = JointCandidate("rate_limit", "axis").applied({"slowness": 2.0})
    search = search_of(axis, simulated(axis, logs, (slow,)), ("rate_limit",))
    found = [trial for trial in search.run().rivals if trial[0].fit.who]
    assert found
    assert found[0][0].fit.values[0]["slowness"] == pytest.approx(2.0, rel=0.02)


def test_limits_are_looked_at_below_the_largest_value(axis, by_effort):
    records, peaks = by_effort
    mechanism = Mechanism(axis[0])
    views = [JointResiduals.of(mechanism, record) for record in records]
    tried = levels(views, (), JointCandidate("saturation", "axis"))
    limits = 1.0 / np.array([values["weakness"] for values in tried])
    assert limits[:6] == pytest.approx(max(peaks) * np.array([0.95, 0.88, 0.8, 0.7, 0.6, 0.5]))
    # A command that jumps by 0.4 rad in a period of 10 ms has a speed of 40 rad/s; limits of some rad/s are looked at, too.
    assert limits[-1] < 0.04 * max(peaks)
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


def test_a_command_that_holds_does_not_swing_where_samples_were_lost():
    time = 0.01 * np.arange(400)
    stairs = np.floor(time / 0.08)
    kept = np.ones(400, bool)
    kept[[37, 112, 301]] = False
    record = Record("stairs", time[kept], ("axis",), {"command": stairs[kept, None]}, {})
    _, commands = with_lost_commands(record)
    assert commands["command"][[37, 301], 0] == pytest.approx(stairs[[37, 301]], abs=1e-12)
    # A command lost at a jump cannot be known; the estimate stays between its neighbours.
    assert stairs[111] <= commands["command"][112, 0] <= stairs[113]


def test_a_log_that_skips_as_a_habit_lost_nothing():
    time = 0.01 * np.arange(400)
    kept = np.ones(400, bool)
    kept[5::8] = False
    record = wave(time[kept])
    assert with_lost_commands(record)[0] is record.time


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


def test_a_speed_computed_from_a_position_bears_no_witness_of_its_jolt(axis):
    """An encoder that misread one sample errs in the speed that was computed from it, too."""
    views, left = residuals_of(axis, ("position",), 5)
    for view, row in zip(views, left, strict=True):
        places = [view.channels.index((kind, 0)) for kind in ("position", "velocity")]
        row[:, places[1]] = np.gradient(row[:, places[0]])
        assert not jolted(view, row)


def test_noise_with_outliers_is_no_motion(axis):
    """Student's t with five degrees of freedom, in all channels, on two records: one of 200 may show two outliers at once."""
    views, _ = residuals_of(axis, (), 0)
    rng = np.random.default_rng(1)
    shape = (len(views[0].record.time), len(views[0].channels))
    heavy = rng.standard_t(5, (200, *shape)) / np.sqrt(5 / 3)
    assert sum(bool(jolted(views[0], row)) for row in heavy) <= 2
