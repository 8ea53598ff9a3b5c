"""Laws of MuJoCo that differ from gsbridge's, and their diagnosis: backlash behind lossy motors, and friction that creeps."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import gap_mismatch
from gsbridge.effects.registry import Applied
from gsbridge.gap.joints.bank import signature_bank
from gsbridge.gap.joints.candidates import JointCandidate
from gsbridge.gap.joints.case import read_joint_case
from gsbridge.gap.joints.diagnose import views_of
from gsbridge.gap.joints.fit import derivatives, fit, settled
from gsbridge.gap.joints.identify import JointIdentification
from gsbridge.gap.joints.mechanism.replay import Mechanism
from gsbridge.gap.joints.pooled import PooledResiduals, spread_of


def views(folder, hidden):
    """Residuals of the three-joint arm of tier T6 in which something is hidden."""
    order = gap_mismatch.Order("single", hidden, tuple(hidden), "soft", "white", 11)
    case = read_joint_case(gap_mismatch.write_case(order, folder, 11))
    return views_of(Mechanism(case.system), case.records)


@pytest.mark.parametrize("gap", [0.002, 0.009])
def test_losses_act_before_the_play(tmp_path, gap):
    """The motor's damping is MuJoCo's, on the joint of the rotor; the load turns freely within the play."""
    view = views(tmp_path, {"backlash:yaw": gap})["fit"]

    def left(*effects):
        """Mean square residual beyond the noise."""
        return float((view.residual(effects) ** 2).sum() / view.freedom) - 1.0

    sizes = {factor: left(Applied("backlash", "yaw", {"gap": factor * gap})) for factor in (0.6, 1.0, 1.6)}
    assert sizes[1.0] < 0.2 * min(sizes[0.6], sizes[1.6], left())


def test_a_size_of_play_is_sought_beyond_where_slopes_lead(tmp_path):
    found = views(tmp_path, {"backlash:yaw": 0.0108})
    both, who = PooledResiduals((found["fit"], found["select"])), JointCandidate("backlash", "yaw")
    astray = fit(both, [who], [{"gap": 0.0108}])
    astray = replace(astray, effects=(who.applied({"gap": 1.03 * astray.values[0]["gap"]}),))
    again = settled(both, astray)
    assert again.chi2 < float((both.residual(astray.effects) ** 2).sum())
    assert again.values[0]["gap"] == pytest.approx(0.0108, rel=0.015)
    assert settled(both, again).chi2 <= again.chi2


def test_errors_that_come_back_with_the_motion_widen_intervals(tmp_path):
    """MuJoCo's friction gives way: what it holds less than a dry one is no noise, and comes back with every reversal."""
    true = 1.3
    found = views(tmp_path, {"coulomb:yaw": true})
    both = PooledResiduals((found["fit"], found["select"]))
    fitted = fit(both, [JointCandidate("coulomb", "yaw")], [{"torque": 1.0}])
    spread = float(spread_of(both, fitted.effects, derivatives(both, fitted))[0])
    astray = abs(fitted.values[0]["torque"] - true)
    assert astray > 5.0 * fitted.deviations[0]
    assert astray < 2.5 * spread
    assert spread < 0.1 * true
    assert np.isfinite(spread)


def test_much_play_is_found_though_no_signature_of_little_play_looks_like_it(tmp_path):
    found = views(tmp_path, {"backlash:yaw": 0.011})
    who = [JointCandidate(name, "yaw") for name in ("backlash", "eccentricity")]
    search = JointIdentification(found["fit"], found["select"], signature_bank(found["fit"], who, tmp_path / "bank"), who)
    search.run()
    (play,) = search._thresholds([])
    assert play.fit.values[0]["gap"] == pytest.approx(0.011, rel=0.03)
    # If another effect already explains most, the search for thresholds is skipped.
    assert search._thresholds([play]) == []
