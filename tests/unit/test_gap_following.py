"""Columns that cannot belong to a joint under feedback control: a wrong sign, another order, the same record twice."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.errors import InputError
from gsbridge.gap.formats.following import check_following, check_velocity, differenced
from gsbridge.gap.formats.records import Record
from gsbridge.gap.formats.shared import _overlap, shared_motion

TIME = np.arange(500) / 50
JOINTS = ("pan", "lift", "elbow")
COMMAND = 0.3 * np.sin(2 * np.pi * TIME[:, None] * np.array([0.3, 0.53, 0.71]) + np.array([0.0, 1.0, 2.0]))

POSITION = COMMAND + 1e-4 * np.random.default_rng(1).standard_normal(COMMAND.shape)
BEHIND = np.diff(POSITION, axis=0, prepend=POSITION[:1]) * 50
AHEAD = np.diff(POSITION, axis=0, append=POSITION[-1:]) * 50
SPEED = np.gradient(COMMAND, 1 / 50, axis=0)


def record(position, command=COMMAND):
    return Record("a", TIME, JOINTS, {"command": command}, {"position": position})


def test_positions_that_lag_and_err_are_taken():
    late = np.stack([np.interp(TIME - 0.1, TIME, column) for column in COMMAND.T], axis=1)
    check_following(record(late + 0.05), "a.csv")
    check_following(record(late, np.zeros_like(COMMAND)), "a.csv")


def test_a_wrong_sign_is_refused():
    with pytest.raises(InputError, match=r"'lift' moves against its command \(correlation -1\.00\)\. Turn the sign"):
        check_following(record(COMMAND * [1, -1, 1]), "a.csv")


def test_another_order_is_refused():
    with pytest.raises(InputError, match=r"'position\.pan' follows 'command\.lift', not its own command"):
        check_following(record(COMMAND[:, [1, 2, 0]]), "a.csv")


def test_one_record_in_two_roles_is_told():
    first, other = record(COMMAND), record(COMMAND[::-1], COMMAND[::-1])
    assert shared_motion({"fit": first, "select": other}) == []
    (reason,) = shared_motion({"fit": first, "select": other, "verify": replace(first, name="b")})
    assert "'fit' and 'verify' are one and the same record" in reason


def test_records_that_overlap_or_repeat_a_motion_are_told():
    noise = 1e-4 * np.random.default_rng(3).standard_normal(COMMAND.shape)
    whole = record(COMMAND + noise)
    late = replace(
        whole, time=TIME[200:] - TIME[200], commands={"command": COMMAND[200:]}, measured={"position": (COMMAND + noise)[200:]}
    )
    (reason,) = shared_motion({"fit": whole, "verify": late})
    assert reason.startswith("100 % of the shorter of 'fit' and 'verify' lies in the other")
    # The motion once more: nothing measured is equal, the commands are.
    (reason,) = shared_motion({"fit": whole, "select": record(COMMAND + noise[::-1])})
    assert "have the same commands" in reason
    # A joint that rests at a coarse encoder shows the same numbers in every record.
    still, moved = np.zeros_like(COMMAND), np.round(COMMAND, 2)
    assert shared_motion({"fit": record(still, COMMAND), "select": record(moved, COMMAND[::-1])}) == []


def stretches(values):
    """The stretches of a motion by their bytes, as `shared_motion` knows them by numbers."""
    begins = np.concatenate([[0], np.flatnonzero(np.abs(np.diff(values, axis=0)).max(axis=1) > 0) + 1])
    places, held = values[begins], np.diff(np.append(begins, len(values)))
    return Counter(places[k : k + 8].tobytes() + held[k + 1 : k + 7].tobytes() for k in range(len(places) - 7))


@given(st.integers(0, 2**31), st.floats(0.0, 1.0), st.integers(1, 3))
@settings(max_examples=30, deadline=None)
def test_the_overlap_of_records_is_that_of_their_bytes(seed, share, joints):
    rng = np.random.default_rng(seed)
    one, own = (np.round(rng.normal(size=(600, joints)).cumsum(axis=0), 0) for _ in range(2))
    cut = round(share * 400)
    other = np.concatenate([one[100 : 100 + cut], own[: 600 - cut]])
    a, b = stretches(one), stretches(other)
    rows = [Record("a", np.arange(600) / 100, tuple("abc"[:joints]), {}, {"position": values}) for values in (one, other)]
    assert _overlap(*rows) == pytest.approx((a & b).total() / min(a.total(), b.total()))


@pytest.mark.parametrize(("one", "other"), [(0.05, 0.08), (0.10, 0.15)])
def test_sweeps_of_other_speeds_share_the_steps_of_an_encoder_and_no_motion(one, other):
    time, step = np.arange(20_000) / 1000, 2 * np.pi / 4096

    def sweep(speed):
        way = 0.3 * np.abs((speed * time / 0.3) % 2 - 1)[:, None]
        return Record("a", time, ("j",), {"command": way}, {"position": step * np.round(way / step)})

    assert shared_motion({"fit": sweep(one), "select": sweep(other)}) == []
    whole = sweep(one)
    part = replace(whole, time=time[:15_000], commands={"command": whole.commands["command"][5000:]},
                   measured={"position": whole.measured["position"][5000:]})  # fmt: skip
    (reason,) = shared_motion({"fit": whole, "select": part})
    assert "lies in the other" in reason


def sped(speed, command_speed=None):
    commands = {"command": COMMAND} if command_speed is None else {"command": COMMAND, "command_velocity": command_speed}
    return Record("a", TIME, JOINTS, commands, {"position": POSITION, "velocity": speed})


def test_speeds_that_belong_to_the_positions_are_taken():
    filtered = 0.8 * np.stack([np.interp(TIME - 0.04, TIME, column) for column in SPEED.T], axis=1)
    for speed in (SPEED, BEHIND, filtered, SPEED + 0.1 * np.random.default_rng(4).standard_normal(SPEED.shape)):
        check_velocity(sped(speed, SPEED), "a.csv")
    # A controller may well be told to brake at every moment.
    check_velocity(sped(SPEED, np.zeros_like(SPEED)), "a.csv")
    check_velocity(record(COMMAND), "a.csv")


@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.5])
@pytest.mark.parametrize("stamps", ["clusters", "bursts", "missing"])
def test_uneven_sampling_with_right_stamps_makes_no_speed_wrong(frequency, stamps):
    """Three samples within 0.2 ms of each tick of 10 ms; five at 1 kHz every 50 ms; two fifths of the samples lost."""
    if stamps == "clusters":
        time = (np.arange(800)[:, None] / 100 + np.arange(3) * 1e-4).ravel()
    elif stamps == "bursts":
        time = (np.arange(160)[:, None] / 20 + np.arange(5) * 1e-3).ravel()
    else:
        time = np.sort(np.random.default_rng(6).choice(np.arange(800) / 100, 480, replace=False))
    angle = 2 * np.pi * frequency * time
    place, speed = 0.4 * np.sin(angle)[:, None], 0.4 * 2 * np.pi * frequency * np.cos(angle)[:, None]
    uneven = Record("a", time, ("j",), {"command": place}, {"position": place, "velocity": speed})
    check_velocity(uneven, "a.csv")
    with pytest.raises(InputError, match="runs against"):
        check_velocity(replace(uneven, measured={"position": place, "velocity": -speed}), "a.csv")


def test_speeds_that_a_drive_resolves_coarsely_are_taken():
    time, rng = np.arange(3000) / 100, np.random.default_rng(7)
    # A turntable at a steady speed, and a motion below the resolution of a drive.
    steady = 10.0 * time[:, None] + 1e-3 * rng.standard_normal((3000, 1))
    slow = 0.1 * np.sin(2 * np.pi * 0.07 * time)[:, None]
    for place, speed in ((steady, np.full_like(steady, 10.0)), (slow, np.zeros_like(slow))):
        check_velocity(Record("a", time, ("j",), {}, {"position": place, "velocity": speed}), "a.csv")


@pytest.mark.parametrize(
    ("speed", "command_speed", "told"),
    [
        (SPEED * [1, -1, 1], SPEED, r"'velocity\.lift' runs against 'position\.lift' \(correlation -1\.00\)"),
        (SPEED * 30 / np.pi, SPEED, r"'velocity\.pan' is 9\.5\d times what .* revolutions per minute"),
        (SPEED * [1, 1, 0], SPEED, r"'velocity\.elbow' is 0 in every row, while the joint moves"),
        (SPEED / 4, SPEED, r"'velocity\.pan' is 0\.25 times"),
        (SPEED, SPEED * 180 / np.pi, r"'command_velocity\.pan' is 57\.\d times what 'command\.pan'"),
        (SPEED, SPEED * [1, 1, -1], r"'command_velocity\.elbow' runs against 'command\.elbow'"),
    ],
)
def test_speeds_that_contradict_the_positions_are_refused(speed, command_speed, told):
    with pytest.raises(InputError, match=told):
        check_velocity(sped(speed, command_speed), "a.csv")


@pytest.mark.parametrize(
    ("speed", "told"),
    [
        (np.gradient(POSITION, 1 / 50, axis=0), True),
        (np.round(BEHIND, 4), True),
        (AHEAD, True),
        # Sensors of their own, one joint of which is good; and nothing at all.
        (SPEED + 5e-3 * np.random.default_rng(2).standard_normal(SPEED.shape), False),
        (np.concatenate([BEHIND[:, :2], SPEED[:, 2:]], axis=1), False),
        (SPEED, False),
        (np.zeros_like(SPEED), False),
    ],
)
def test_speeds_that_are_differences_of_positions_are_told(speed, told):
    first = record(POSITION)
    assert differenced(replace(first, measured={"position": POSITION, "velocity": speed})) == told
    assert not differenced(first)
