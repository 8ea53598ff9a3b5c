"""Values that `policy.json` must not hold, since an arm is driven by it."""

import json

import pytest
from driver_fixture import spec, write_policy, write_registration

from gsbridge.cli import main
from gsbridge.errors import InputError
from gsbridge.policy.interface import PolicyInterface

NAN, INF = float("nan"), float("inf")
PROPRIO = ("observation", "proprio")
ODD = {
    ("control_hz",): (0, -20, 1e9, NAN, INF, True, "20", None),
    ("task",): ("dance", None, 1, "pick_and_place"),
    ("observation", "image", "size_px"): (INF, 0, -64, True, NAN, 64.5, "64", None, 128, 10**400),
    ("observation", "image", "field_of_view_rad"): (NAN, INF, 0, -1, 42.5, "wide", True),
    (*PROPRIO, "names"): ([], ["tool_x"], "tool_x, tool_y", None, 12, [1] * 12, {"a": 1}),
    (*PROPRIO, "bound"): (NAN, 1, None, "10"),
    (*PROPRIO, "workspace_lower_m"): ([0.5] * 3, [NAN] * 3, [0, 0], "abc", None, [-1e6, -1e6, 0], [0, 0.1, -0.2], [[0]] * 3),
    (*PROPRIO, "workspace_upper_m"): ([-1, -1, -1], [INF] * 3, [1, 1, 1, 1], {"x": 1}, 5, [1e3, 1e3, 1e3], [True] * 3),
    (*PROPRIO, "workspace_yaw_rad"): ([1, -1], [-90, 90], [NAN, 1], [0], [0, 1, 2], "ab", None),
    (*PROPRIO, "stroke_m"): (NAN, INF, 0, -0.1, 140, True, "wide", None, 10**400),
    ("action", "names"): ([], ["x"] * 5, ["y", "x", "z", "yaw", "aperture"], "xyzab", None),
    ("action", "low"): (1.0, NAN, -2),
    ("action", "high"): (-1.0, True, 1e9),
    ("action", "position_m"): (0.1, NAN, None),
    ("action", "tether"): (NAN, INF, 2.5, "3", None, [3]),
    ("environment", "max_steps"): (0, -1, NAN, 10**9, True, "80"),
    ("environment", "position_step"): (NAN, 1.0, -0.01, True, 0.012),
    ("environment", "start_centre"): ([], [NAN, 0], "ab", None, [0], [0, 0, 0]),
    ("environment", "start_yaw"): ([], [1, -1], None, [0, INF]),
    ("environment", "plate"): ([], 5, {"x": 1}, {"x": NAN, "y": 0}),
    ("environment", "speed"): (1,),
    ("environment",): (None, [], 5, "abc"),
    ("observation",): (None, [], {}),
    ("action",): (None, [], {}),
}  # fmt: skip
CASES = [(keys, value) for keys, values in ODD.items() for value in values]


def changed(keys, value, content):
    place = content
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    return content


@pytest.mark.parametrize(("keys", "value"), CASES, ids=[f"{'.'.join(keys)}={str(value)[:30]}" for keys, value in CASES])
def test_an_odd_interface_is_refused(keys, value):
    with pytest.raises(InputError) as told:
        PolicyInterface.of(changed(keys, value, spec()))
    assert str(told.value).startswith("policy.json")
    assert len(str(told.value)) < 600
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    "pose", [[[1.0]], "abc", None, [[NAN] * 4] * 4, [[2.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]]
)
def test_an_odd_mount_is_refused(pose):
    eye = [[float(row == column) for column in range(4)] for row in range(4)]
    keys = ("flange_from_camera", "table_from_tool_at_rest", "base_from_table")
    assert PolicyInterface.of({**spec(), "robot": dict.fromkeys(keys, eye)})
    for key in keys:
        robot = {**dict.fromkeys(keys, eye), key: pose}
        with pytest.raises(InputError, match=r"policy\.json"):
            PolicyInterface.of({**spec(), "robot": robot})


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("format",), 2), (("format",), True), (("format",), None), (("format",), [1]), (("sha256",), None),
        (("observation", "image", "size_px"), INF), (("observation", "image", "size_px"), True), (("action", "names"), 5),
        (("observation", "proprio", "names"), "twelve letter"), (("control_hz",), 0), (("task",), None), (("observation",), []),
    ],
)  # fmt: skip
def test_an_odd_policy_ends_in_one_line_before_a_driver_is_made(tmp_path, capsys, keys, value):
    folder = write_policy(tmp_path / "policy")
    content = json.loads((folder / "policy.json").read_text())
    (folder / "policy.json").write_text(json.dumps(changed(keys, value, content)))
    registration = write_registration(tmp_path / "registration.json")
    given = ["--policy", str(folder), "--registration", str(registration), "--driver", "no_such_module:Arm"]
    assert main(["run-policy", *given]) == 1
    told = capsys.readouterr().err.strip().splitlines()
    assert len(told) == 1
    assert "policy" in told[0]
    assert "no_such_module" not in told[0]
