"""Columns that cannot belong to a joint under feedback control: a wrong sign, another order, the same record twice."""

from dataclasses import replace

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.gap.formats.following import check_following, differenced
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.case import _repeated

TIME = np.arange(500) / 50
JOINTS = ("pan", "lift", "elbow")
COMMAND = 0.3 * np.sin(2 * np.pi * TIME[:, None] * np.array([0.3, 0.53, 0.71]) + np.array([0.0, 1.0, 2.0]))


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
    first = record(COMMAND)
    again = replace(first, measured={"position": COMMAND + 1e-3})
    assert _repeated({"fit": first, "select": again}) == []
    (reason,) = _repeated({"fit": first, "select": again, "verify": replace(first, name="b")})
    assert "'fit' and 'verify' are one and the same record" in reason


POSITION = COMMAND + 1e-4 * np.random.default_rng(1).standard_normal(COMMAND.shape)
BEHIND = np.diff(POSITION, axis=0, prepend=POSITION[:1]) * 50
AHEAD = np.diff(POSITION, axis=0, append=POSITION[-1:]) * 50
SPEED = np.gradient(COMMAND, 1 / 50, axis=0)


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
