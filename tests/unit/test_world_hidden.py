"""Hidden parameters of the mirror: ranges, seeds, further worlds."""

import dataclasses

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.reality.world.hidden import Hidden, Ranges
from gsbridge.reality.world.world_variants import LABORATORY, world_variant

NAMES = [item.name for item in dataclasses.fields(Ranges)]


def test_same_seed_same_world():
    assert Hidden.draw(4) == Hidden.draw(4) != Hidden.draw(5)


@pytest.mark.parametrize("name", NAMES)
def test_draws_fill_their_range_and_never_leave_it(name):
    low, high = getattr(Ranges(), name)
    values = np.array([getattr(Hidden.draw(seed), name) for seed in range(200)]).reshape(200, -1)
    assert values.min() >= low
    assert values.max() <= high
    # 200 uniform draws leave a tenth free at an end once in 10^9 times.
    assert values.min(0).max() < low + 0.1 * (high - low)
    assert values.max(0).min() > high - 0.1 * (high - low)


def test_what_the_specification_asks_for():
    ranges = Ranges()
    assert ranges.mass == (0.8, 1.2)
    assert ranges.latency == (0.0, 0.060)
    assert Hidden().tint == (1.0, 1.0, 1.0)


def test_a_parameter_has_its_own_stream():
    fewer = dataclasses.replace(Ranges(), mass=(0.5, 0.6))
    one, two = Hidden.draw(3), Hidden.draw(3, fewer)
    assert dataclasses.replace(two, mass=one.mass) == one


def test_further_worlds_change_only_what_they_name():
    base = Hidden.draw(1)
    tinted = base.changed({"tint": [0.9, 0.95, 1.15], "pedestal": 0.03, "stiffness": 0.9})
    assert tinted.tint == (0.9, 0.95, 1.15)
    assert tinted.stiffness == (0.9,) * 7
    assert dataclasses.replace(tinted, tint=base.tint, pedestal=base.pedestal, stiffness=base.stiffness) == base


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tnit": 1.0}, "'tnit' is unknown"),
        ({"mass": -1.0}, "right sign"),
        ({"mass": 0.0}, "right sign"),
        ({"mass": float("nan")}, "finite"),
        ({"clutter": 1e9}, "0 to 100 things"),
        ({"decoys": 1.5}, "0 to 100 things"),
        ({"latency": 60.0}, "1 s at most"),
        ({"mass": [1.0]}, "one number"),
        ({"mass": "heavy"}, "one number"),
        ({"mass": True}, "one number"),
        ({"tint": [1.0, 2.0]}, "3 numbers"),
        ({"latency": -0.01}, "right sign"),
    ],
)
def test_nonsense_is_refused_and_the_place_is_named(changes, words):
    with pytest.raises(InputError, match=words) as caught:
        Hidden().changed(changes, source="config.yaml: worlds: mirror_odd")
    assert "mirror_odd" in str(caught.value)


def test_further_worlds_stand_in_the_same_laboratory():
    home, other = world_variant(1, 1), world_variant(1, 2)
    assert home == Hidden.draw(1)
    for item in dataclasses.fields(Hidden):
        same = getattr(home, item.name) == getattr(other, item.name)
        drawn = item.name in NAMES
        assert same == (item.name in LABORATORY or not drawn), item.name


def test_further_worlds_set_what_they_name():
    assert world_variant(1, 2, {"latency": 0.1}).latency == 0.1
    with pytest.raises(InputError, match=r"config: worlds.odd.*latencey"):
        world_variant(1, 2, {"latencey": 0.1}, "config: worlds.odd")
