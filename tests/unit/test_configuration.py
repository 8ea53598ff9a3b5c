"""Names in the configuration must point somewhere."""

import copy

import pytest

from gsbridge.configuration import check_configuration
from gsbridge.errors import InputError

SCENE = {
    "kind": "object",
    "source": {"film": "cake"},
    "camera": "phone",
    "board": "a4",
    "require_scale": True,
    "known_length": None,
}
CONFIG = {
    "preset": "toy",
    "presets": {"toy": {"scenes": ["cake"]}},
    "cameras": {"phone": {"calibrate_from": ["cake"]}},
    "scenes": {"cake": SCENE},
}


def test_a_consistent_configuration_passes():
    check_configuration(CONFIG)


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        (("preset",), "big", "big"),
        (("presets", "toy", "scenes"), ["mug"], "mug"),
        (("scenes", "cake", "camera"), "tablet", "tablet"),
        (("cameras", "phone", "calibrate_from"), ["mug"], "mug"),
        (("scenes", "cake", "board"), None, "require_scale"),
    ],
)
def test_a_name_that_points_nowhere_is_named(path, value, named):
    config = copy.deepcopy(CONFIG)
    target = config
    for key in path[:-1]:
        target = target[key]
    target[path[-1]] = value
    with pytest.raises(InputError, match=named):
        check_configuration(config)
