"""Sizes of effects of thrown bodies: grids, searches and fits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from thrown_bodies import HORIZON, MODEL, own_throws, soft_ball

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.gap.contact import search
from gsbridge.gap.contact.body import parse_body
from gsbridge.gap.contact.grid import grid_ways
from gsbridge.gap.contact.interval import intervals
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.search import lowest, promised, refine, screen


@settings(max_examples=40)
@given(st.floats(-0.9, 0.9), st.floats(-1.0, 1.0), st.floats(0.05, 0.5), st.floats(0.0, 1.0))
def test_a_search_finds_the_minimum_from_anywhere(centre, begin, width, sharp):
    """Of a V, a parabola and what lies between, in few looks."""
    looks = []

    def error(value):
        looks.append(value)
        return 0.01 + sharp * abs(value - centre) + (1.1 - sharp) * (value - centre) ** 2

    known, inside = lowest(error, begin, width, -2.0, 2.0)
    assert inside
    assert min(known, key=known.get) == pytest.approx(centre, abs=0.15)
    assert len(looks) == len(known) <= 16


def test_a_search_says_when_it_stops_at_a_bound():
    known, inside = lowest(lambda value: -value, 0.0, 0.1, -1.0, 1.0)
    assert min(known, key=known.get) == 1.0
    assert not inside


def test_a_figure_that_cannot_be_negative_may_be_nothing():
    """Throws without any friction: the coefficient cannot go below zero, whatever the parameter could."""
    replay = ThrowReplay(parse_body(MODEL, "."), own_throws(0.0, 8, 2), HORIZON)
    fit = refine(replay, (Applied("contact_friction", "", {"friction": -0.45}),))
    assert fit.effects[0].parameters["friction"] == pytest.approx(-0.5, abs=0.02)
    assert min(min(profile) for profile in fit.profiles.values()) >= -0.5
    assert fit.converged
    (spans,) = intervals(replay, fit, np.random.default_rng(0))
    assert spans["friction"][0] == -0.5
    assert -0.5 < spans["friction"][1] < -0.4


def test_where_a_body_sticks_the_least_friction_that_holds_it_is_taken():
    """Any larger coefficient explains as much, up to the largest that makes sense."""
    replay = ThrowReplay(parse_body({**MODEL, "contact": {"friction": 0.1}}, "."), own_throws(1.1, 8, 3), HORIZON)
    fit = refine(replay, (Applied("contact_friction", "", {"friction": 0.9}),))
    assert fit.converged
    assert 0.6 < fit.effects[0].parameters["friction"] <= 1.0
    (spans,) = intervals(replay, fit, np.random.default_rng(0))
    assert 0.6 < spans["friction"][0] < 1.0
    assert spans["friction"][1] == 2.0


@pytest.mark.parametrize(
    ("known", "begin"),
    [
        ({0.1: 5.0, 0.9: 1.0, 1.4: 1.0, 2.0: 1.0}, 0.9),
        # As good elsewhere, but not on the way there, or to the other side.
        ({0.1: 5.0, 0.5: 1.0, 0.9: 3.0, 1.4: 1.0, 2.0: 1.0}, 1.4),
        ({-0.4: 1.0, 0.1: 5.0, 0.9: 1.0, 2.0: 1.0}, 0.9),
        ({-2.0: 1.0, -0.9: 1.0, -0.1: 5.0}, -0.9),
    ],
)
def test_a_plateau_begins_where_all_beyond_is_as_good(known, begin):
    best = max(known, key=lambda value: (known[value] == 1.0, abs(value)))
    assert search._plateau(known, best) == (begin, True)


def test_a_size_at_any_other_bound_has_not_converged():
    """What was nothing before is not named for staying so, nor what would be smaller than the catalogue allows."""
    replay = ThrowReplay(parse_body(MODEL, "."), own_throws(0.5, 8, 2), HORIZON)
    assert not refine(replay, (Applied("rolling_friction", "", {"arm": 0.0}),)).converged
    far = ThrowReplay(parse_body({**MODEL, "box": [0.4, 0.4, 0.4]}, "."), own_throws(0.5, 8, 2), HORIZON)
    assert not refine(far, (Applied("object_size", "", {"share": -0.5}),)).converged


def test_a_table_that_tilts_about_both_axes_is_found():
    """Its tilt is far from what either axis alone explains, and a search along the axes ends in the valley of one of them."""
    body = parse_body(MODEL, ".")
    tilt = {"about_x": -0.08, "about_y": 0.06}
    replay = ThrowReplay(body, own_throws(0.5, 12, 3, effects=(Applied("table_tilt", "", tilt),)), HORIZON)
    match = screen(replay, "table_tilt")
    assert all(match.effect.parameters[name] * size > 0.0 for name, size in tilt.items())
    fit = refine(replay, (match.effect,))
    assert fit.effects[0].parameters == pytest.approx(tilt, abs=0.01)


@pytest.mark.parametrize(("name", "size"), [("inertia_scale", 0.05), ("restitution", 0.03)])
def test_a_size_below_the_smallest_of_the_grid_is_found(name, size):
    """The smallest size that is tried goes so far beyond the hidden one that nothing at all does better than it."""
    parameter = BODY_EFFECTS[name].parameters[0]
    replay = ThrowReplay(
        parse_body(MODEL, "."), own_throws(0.5, 12, 4, effects=(Applied(name, "", {parameter.name: size}),)), HORIZON
    )
    least = Applied(name, "", {parameter.name: parameter.typical})
    assert replay.errors((least,)).mean() > replay.errors().mean()
    match = screen(replay, name)
    assert 0.2 * size < match.effect.parameters[parameter.name] < 3.0 * size
    assert match.error < 0.8 * replay.errors().mean()


def test_a_size_that_the_smallest_of_the_grid_overshoots_is_found():
    """The smallest size that is tried does help, but what lies below it helps more."""
    replay = ThrowReplay(
        parse_body(MODEL, "."), own_throws(0.5, 12, 4, effects=(Applied("inertia_scale", "", {"share": 0.11}),)), HORIZON
    )
    least = Applied("inertia_scale", "", {"share": BODY_EFFECTS["inertia_scale"].parameters[0].typical})
    assert replay.errors((least,)).mean() < replay.errors().mean()
    match = screen(replay, "inertia_scale")
    assert match.effect.parameters["share"] == pytest.approx(0.11, abs=0.05)
    assert match.error < 0.7 * replay.errors((least,)).mean()


def test_a_large_size_that_fits_by_chance_hides_no_small_one(monkeypatch):
    """The smallest size that is tried is worse than nothing; here the largest is a little better."""
    hidden = Applied("inertia_scale", "", {"share": 0.05})
    replay = ThrowReplay(parse_body(MODEL, "."), own_throws(0.5, 12, 4, effects=(hidden,)), HORIZON)
    plain, far, measured = replay.errors().mean(), grid_ways(replay.body, "inertia_scale")[-1][-1], search.mean_error
    monkeypatch.setattr(search, "mean_error", lambda on, who: 0.99 * plain if tuple(who) == (far,) else measured(on, who))
    assert 0.01 < screen(replay, "inertia_scale").effect.parameters["share"] < 0.15


def test_a_figure_is_halved_on_its_way_to_nothing_and_raised_in_steps():
    lowered, raised = sorted(
        grid_ways(parse_body(MODEL, "."), "contact_friction"), key=lambda way: way[0].parameters["friction"]
    )
    left = [0.5 + point.parameters["friction"] for point in lowered]
    assert left == pytest.approx([0.45, 0.375, 0.25, 0.125, 0.0625, 0.0])
    assert [point.parameters["friction"] for point in raised] == pytest.approx([0.05, 0.125, 0.3, 0.6])
    # Restitution is zero in the model, so nothing can be subtracted from it.
    assert all(len(way) == 3 for way in grid_ways(parse_body(MODEL, "."), "restitution"))


def test_a_ball_that_slides_is_found_though_it_rolls_with_nearly_any_friction(tmp_path):
    replay = soft_ball(tmp_path, 1.0, friction=0.04)
    match = screen(replay, "contact_friction")
    fit = refine(replay, (match.effect,))
    assert fit.converged
    assert fit.effects[0].parameters["friction"] == pytest.approx(-0.36, abs=0.01)
    assert fit.error < 0.2 * replay.errors().mean()


def test_the_effect_that_is_missing_promises_most():
    """Beside a friction that is found, and without one simulation more than those of the grids."""
    replay = ThrowReplay(parse_body(MODEL, "."), own_throws(0.3, 12, 1), HORIZON)
    base, names = (Applied("inertia_scale", "", {"share": 0.1}),), ("contact_friction", "gravity_scale", "linear_damping")
    for effects in (base, *((point,) for name in names for way in grid_ways(replay.body, name) for point in way)):
        replay.flights(effects)
    before = replay.runs
    found = {name: promised(replay, name, base) for name in names}
    assert replay.runs == before
    shares = {name: share for name, (_, share) in found.items()}
    assert found["contact_friction"][0].parameters["friction"] == pytest.approx(-0.2, abs=0.08)
    assert max(shares, key=shares.get) == "contact_friction"
    assert 0.0 <= min(shares.values()) <= max(shares.values()) <= 1.0


def test_a_fitted_size_is_the_hidden_one():
    replay = ThrowReplay(parse_body(MODEL, "."), own_throws(0.3, 12, 1), HORIZON)
    fit = refine(replay, (Applied("contact_friction", "", {"friction": -0.1}),))
    assert fit.converged
    assert fit.effects[0].parameters["friction"] == pytest.approx(-0.2, abs=0.02)
    assert fit.error < 0.1 * replay.errors().mean()
    phases, after = replay.phases(), replay.phases(fit.effects)
    assert after["after"] < 0.2 * phases["after"]
    # Before the first touch friction explains nothing.
    assert after["flight"] == pytest.approx(phases["flight"], rel=1e-9)
