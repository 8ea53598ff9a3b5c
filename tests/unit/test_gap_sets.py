"""Sets of effects are compared with sets in which another effect stands in for one of theirs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from axis_logs import axis_in, records_of, simulated

from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.identify import ThrowHypothesis, ThrowIdentification, ThrowRules
from gsbridge.gap.contact.search import ThrowFit
from gsbridge.gap.diagnosis.results import Rules
from gsbridge.gap.diagnosis.verdict import decide
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.arcs import arcs_of
from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.candidates import JointCandidate
from gsbridge.gap.joints.diagnose import diagnose_joints
from gsbridge.gap.joints.fit import fit
from gsbridge.gap.joints.identify import JointIdentification
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.stand_ins import stand_ins
from gsbridge.gap.joints.verify import stepped


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    return axis_in(tmp_path_factory.mktemp("axis"))


def test_an_effect_is_fitted_beside_its_special_cases(axis):
    """Friction that differs between directions is not named while nobody has fitted friction that does not."""
    mechanism, records = Mechanism(axis[0]), records_of(axis)
    records = simulated(axis, records, (JointCandidate("coulomb", "axis").applied({"torque": 0.3}),))
    views = [JointResiduals.of(mechanism, records[role]) for role in ("fit", "select")]
    who = [JointCandidate(name, "axis") for name in ("coulomb", "coulomb_asym")]
    search = JointIdentification(views[0], views[1], signature_bank(views[0], who, axis[2] / "bank"), who)
    rich = search.trial_of(fit(views[0], who[1:], ({"torque": 0.29, "skew": 0.01},)))
    (plain,) = search._simpler([rich], [rich])
    assert plain.names == ("coulomb:axis",)
    assert plain.fit.values[0]["torque"] == pytest.approx(0.3, rel=0.01)
    assert decide([rich, plain], search.rules, search.floor).trials[0] is plain
    assert search._simpler([rich], [rich, plain]) == []


def test_a_set_is_compared_with_what_stands_for_one_of_its_effects(axis):
    """A delay beside friction looks much like a lag: the pair is not named before the other pair was fitted."""
    friction, late, lag = JointCandidate("coulomb", "axis"), JointCandidate("command_delay"), JointCandidate("lag")
    mechanism = Mechanism(axis[0])
    logs = simulated(axis, records_of(axis), (friction.applied({"torque": 0.3}), lag.applied({"time": 0.004})))
    views = [JointResiduals.of(mechanism, logs[role]) for role in ("fit", "select")]
    who = [friction, JointCandidate("coulomb_asym", "axis"), late, lag, JointCandidate("armature", "axis")]
    search = JointIdentification(views[0], views[1], signature_bank(views[0], who, axis[2] / "bank"), who)
    best = search.trial_of(fit(views[0], (friction, late), ({"torque": 0.3}, {"time": 0.004})))
    # Friction's own special cases and what contains it are compared elsewhere.
    (found,) = stand_ins(views[0], search.screen, best, [best], search.rules.margin)
    assert found.who == (friction, lag)
    assert found.values[0] == best.fit.values[0]
    assert found.values[1]["time"] == pytest.approx(0.004, rel=0.2)
    # The lag explains the change that the delay makes nearly as well as the delay does.
    assert found.behind < 0.05 * float((views[0].residual() ** 2).sum())
    other = search.trial_of(fit(views[0], found.who, found.values))
    assert other.fit.chi2 < best.fit.chi2
    assert stand_ins(views[0], search.screen, best, [best, other], search.rules.margin) == []


def test_a_set_is_compared_with_all_whose_signatures_are_the_same(axis):
    """On one axis that carries its weight, a motor too weak, a link too heavy and a load are one equation."""
    friction, weak = JointCandidate("coulomb", "axis"), JointCandidate("torque_gain", "axis")
    heavy, load = JointCandidate("link_mass", "axis"), JointCandidate("payload")
    hidden = friction.applied({"torque": 0.3}), weak.applied({"change": -0.03})
    logs, who = simulated(axis, records_of(axis), hidden), [friction, weak, heavy, load]
    views = [JointResiduals.of(Mechanism(axis[0]), logs[role]) for role in ("fit", "select")]
    search = JointIdentification(*views, signature_bank(views[0], who, axis[2] / "bank"), who)
    best = search.trial_of(fit(views[0], (friction, heavy), ({"torque": 0.3}, {"change": 0.03})))
    # The one that looks most like the link's mass by a hair stands for itself alone.
    found = stand_ins(views[0], search.screen, best, [best], search.rules.margin)
    assert {one.who for one in found} >= {(friction, weak), (friction, load)}


def test_what_was_fitted_and_left_far_more_is_not_among_the_names(axis):
    """A payload's signature promises what a weaker weight explains; no payload weighs less than nothing."""
    weak, heavy, load = JointCandidate("torque_gain", "axis"), JointCandidate("link_mass", "axis"), JointCandidate("payload")
    logs, who = simulated(axis, records_of(axis), (heavy.applied({"change": -0.05}),)), [weak, heavy, load]
    views = [JointResiduals.of(Mechanism(axis[0]), logs[role]) for role in ("fit", "select")]
    finding = JointIdentification(*views, signature_bank(views[0], who, axis[2] / "bank"), who).run()
    assert finding.verdict == "ambiguous"
    assert set(finding.ambiguous) == {str(weak), str(heavy)}


def test_near_twins_are_told_apart_by_no_less_than_the_step_of_time_changes(axis):
    """A delay is simulated in steps; a clock's is not: what tells the two apart may be the step's error alone."""
    late, clock = JointCandidate("command_delay"), JointCandidate("clock_offset")
    fine = replace(axis[0], physics_rate=8 * axis[0].physics_rate)
    logs = simulated((fine, *axis[1:]), records_of(axis), (late.applied({"time": 0.0095}),))
    views = [JointResiduals.of(Mechanism(axis[0]), logs[role]) for role in ("fit", "select")]
    search = JointIdentification(*views, signature_bank(views[0], [late, clock], axis[2] / "bank"), [late, clock])
    rough = search.trial_of(fit(views[0], (late,), ({"time": 0.0095},)))
    sound = stepped(rough, views)
    exact = [JointResiduals.of(Mechanism(fine), logs[role]) for role in ("fit", "select")]
    for before, after, view in ((rough.first, sound.first, exact[0]), (rough.residual, sound.residual, exact[1])):
        truth = view.residual(rough.fit.effects)
        assert np.linalg.norm(after - truth) < 0.5 * np.linalg.norm(before - truth)
    assert sound.chi2 == pytest.approx(float((sound.residual**2).sum()))
    assert sound.fit.chi2 == pytest.approx(float((sound.first**2).sum()))


def test_a_set_that_was_not_compared_with_its_twin_is_not_named(axis):
    """Where the budget ends before the other of two near twins was fitted, nobody knows which of them it is."""
    friction, late, lag = JointCandidate("coulomb", "axis"), JointCandidate("command_delay"), JointCandidate("lag")
    logs = simulated(axis, records_of(axis), (friction.applied({"torque": 0.3}), lag.applied({"time": 0.001})))
    who = [friction, late, lag]

    def searched(budget):
        """The finding from one pair, and the sets that were fitted; no set grows beyond it."""
        views = [JointResiduals.of(Mechanism(axis[0]), logs[role]) for role in ("fit", "select")]
        bank = signature_bank(views[0], who, axis[2] / "bank")
        search = JointIdentification(*views, bank, who, Rules(budget=budget, most=1))
        best = search.trial_of(fit(views[0], (friction, late), ({"torque": 0.3}, {"time": 0.001})))
        search.spare(search._used())
        trials = search._several([best], best)
        return search._decide([best], [], 0.0, ()), [trial.names for trial in trials]

    twins = ("command_delay + coulomb:axis", "coulomb:axis + lag")
    finding, fitted = searched(60)
    assert ("coulomb:axis", "lag") in fitted
    assert finding.verdict == "named"
    finding, fitted = searched(12)
    assert ("coulomb:axis", "lag") not in fitted
    assert (finding.verdict, finding.ambiguous) == ("ambiguous", twins)


def throw_judge(monkeypatch, left):
    """A judge of throws for which each set of effects leaves what `left` says, mm, and the promise of `late` is best."""
    judge = object.__new__(ThrowIdentification)
    judge.rules, judge.plain = ThrowRules(), 10e-3 + np.linspace(0, 1e-4, 20)
    judge.first = judge.few = SimpleNamespace()
    judge.bank = SimpleNamespace(names=("tilt", "wind", "late"))

    def fitted(replay, effects, share=1.0, *, held=0):
        effects = tuple(effects)
        return ThrowFit(effects, 1e-3 * left[frozenset(e.name for e in effects)], True)

    where = "gsbridge.gap.contact.identify"
    monkeypatch.setattr(f"{where}.refine", fitted)
    monkeypatch.setattr(f"{where}.mean_error", lambda replay, effects: fitted(replay, effects).error)
    monkeypatch.setattr(f"{where}.promised", lambda replay, name, base: (Applied(name, "", {}), 1.0))
    spread = np.linspace(-1e-5, 1e-5, 20)
    monkeypatch.setattr(
        ThrowIdentification, "_trials", lambda self, fits: [ThrowHypothesis(found, found.error + spread) for found in fits]
    )
    grown = ThrowHypothesis(fitted(None, [Applied(name, "", {}) for name in ("tilt", "wind")]), 1e-3 * left[TW] + spread)
    return judge, grown


TW, TL, WL = (frozenset(names) for names in (("tilt", "wind"), ("tilt", "late"), ("wind", "late")))


@pytest.mark.parametrize(
    ("alone", "found"),
    # `late` does nearly all by itself, or needs the other.
    [(1.0, []), (5.0, [("late", "tilt")])],
)
def test_a_set_of_throws_that_would_lead_must_be_better_than_its_parts(monkeypatch, alone, found):
    left = {TW: 1.2, TL: 0.9, WL: 9.0} | {
        frozenset({name}): size for name, size in (("tilt", 6.0), ("wind", 7.0), ("late", alone))
    }
    judge, grown = throw_judge(monkeypatch, left)
    assert [trial.names for trial in judge._stand_ins(grown, 0.5e-3)] == found


def test_a_set_of_throws_that_does_as_well_is_a_rival_whatever_its_parts_do(monkeypatch):
    left = {TW: 1.2, TL: 1.25, WL: 9.0} | {frozenset({name}): 1.3 for name in ("tilt", "wind", "late")}
    judge, grown = throw_judge(monkeypatch, left)
    assert [trial.names for trial in judge._stand_ins(grown, 0.5e-3)] == [("late", "tilt")]
    single = ThrowHypothesis(ThrowFit(grown.fit.effects[:1], 6e-3, True), grown.errors)
    assert judge._stand_ins(single, 0.5e-3) == []


def arcs(logged="position", **waves):
    """Labels of arcs among effects given as `name__joint=waves`, waves of zero for what is no ripple.

    The elbow goes twice as far as the shoulder, which turns by one radian.
    """
    who = [JointCandidate(*name.split("__")) for name in waves]
    turns = np.linspace(0.0, 1.0, 50)[:, None] * [1.0, 2.0]
    commands, measured = ({"command": turns}, {"tool": np.zeros((50, 3))}) if logged == "tool" else ({}, {logged: turns})
    record = Record("log", np.arange(50) * 0.01, ("shoulder", "elbow"), commands, measured)
    effects = [c.applied({"waves": count}) for c, count in zip(who, waves.values(), strict=True)]
    return [str(arc) for arc in arcs_of([SimpleNamespace(record=record)], who, effects)]


def test_a_ripple_of_less_than_one_wave_draws_a_curve_beside_another_torque_by_the_angle():
    assert arcs(ripple__shoulder=6.0, effort_offset__shoulder=0) == ["ripple:shoulder"]
    assert arcs(ripple__shoulder=6.5, effort_offset__shoulder=0) == []
    # The elbow goes twice as far, and passes as many waves at half as many per turn.
    assert arcs(ripple__elbow=3.0, spring__elbow=0) == ["ripple:elbow"]
    assert arcs(ripple__elbow=3.5, spring__elbow=0) == []
    assert arcs(ripple__shoulder=3.0, spring__elbow=0) == []
    assert arcs(ripple__shoulder=3.0, coulomb__shoulder=0, viscous__shoulder=0) == []
    assert arcs(ripple__shoulder=3.0) == []
    # A tracker of the tool tells of no joint, whose commands must do.
    assert arcs("tool", ripple__shoulder=6.0, coulomb_asym__shoulder=0) == ["ripple:shoulder"]
    assert arcs("tool", ripple__shoulder=6.5, coulomb_asym__shoulder=0) == []


@pytest.mark.parametrize(
    ("beside", "waves", "verdict"),
    [("coulomb", 2.5, "named"), ("spring", 8.0, "named"), ("effort_offset", 2.5, "arc")],
)
def test_a_curve_over_the_angle_is_drawn_but_not_named(axis, beside, waves, verdict):
    """An arc beside a constant explains all of a gap, and yet may stand for a cable that stiffens; a real ripple does not."""
    parts = {"coulomb": {"torque": 0.3}, "spring": {"stiffness": 2.0, "rest": 0.3}, "effort_offset": {"torque": 0.5}}
    ripple = JointCandidate("ripple", "axis").applied({"sine": 0.4, "cosine": 0.2, "waves": waves})
    logs = simulated(axis, records_of(axis), (JointCandidate(beside, "axis").applied(parts[beside]), ripple))
    found = diagnose_joints(axis[0], logs, axis[2] / "bank", names=("coulomb", "effort_offset", "ripple", "spring", "viscous"))
    if verdict == "named":
        assert found.finding.verdict == "named"
        assert set(found.finding.best.names) == {f"{beside}:axis", "ripple:axis"}
        assert not any("wave" in warning for warning in found.warnings)
        return
    assert found.finding.verdict in ("none_of_the_known", "ambiguous")
    assert not any(entry.verdict == "named" for entry in found.account.entries)
    # The account closes the gap all the same.
    assert found.account.explained > 0.95


def test_an_arc_is_no_sure_part_of_a_larger_set(axis):
    """Friction of either kind beside a constant and an arc: what both explanations share is not named, since it is a curve."""
    parts = {"coulomb": {"torque": 0.05}, "viscous": {"coefficient": 0.02}, "effort_offset": {"torque": 0.5}}
    parts["ripple"] = {"sine": 0.4, "cosine": 0.2, "waves": 2.5}
    shared = [JointCandidate(name, "axis") for name in ("effort_offset", "ripple")]
    logs = simulated(axis, records_of(axis), [c.applied(parts[c.name]) for c in (*shared, JointCandidate("coulomb", "axis"))])
    views = [JointResiduals.of(Mechanism(axis[0]), logs[role]) for role in ("fit", "select")]
    who = [*shared, JointCandidate("coulomb", "axis"), JointCandidate("viscous", "axis")]
    search = JointIdentification(views[0], views[1], signature_bank(views[0], who, axis[2] / "bank"), who)
    sets = [[*shared, who[2]], [*shared, who[3]], shared]
    trials = [search.trial_of(fit(views[0], each, [parts[c.name] for c in each])) for each in sets]
    found = decide(trials, search.rules, search.floor)
    assert search._arcs(trials[0]) == (shared[1],)
    assert min(search._closed(trial) for trial in trials) > 0.9
    assert search._sure_part(found, trials) is None
