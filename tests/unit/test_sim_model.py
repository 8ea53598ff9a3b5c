"""The model file is read strictly, and its camera does what it says."""

import copy

import numpy as np
import pytest
import yaml
from sim_fixture import NOMINAL, content, model

from gsbridge.errors import InputError
from gsbridge.images import linear_from_srgb
from gsbridge.sim.camera import respond
from gsbridge.sim.model import parse_model, read_model


def leaves(values: dict, prefix: tuple = ()):
    """Paths of all values."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from leaves(value, (*prefix, key))
        elif key != "effects":
            yield (*prefix, key)


def changed(path: tuple, value) -> dict:
    values = copy.deepcopy(content())
    place = values
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return values


PATHS = list(leaves(content()))


def test_nominal_model_reads_back_every_value():
    found = read_model(NOMINAL)
    assert (found.substeps, found.time_step, found.period) == (50, 0.001, 0.05)
    assert found.effects == ()
    for path in PATHS:
        value, given = found, content()
        for key in path:
            value, given = getattr(value, key), given[key]
        assert value == (tuple(given) if isinstance(given, list) else given)


def test_every_value_says_its_unit_in_the_file():
    """A number without a comment, or a section without an explanation, is a default by accident."""
    for line in NOMINAL.read_text().splitlines():
        if line.startswith("  ") and not line.lstrip().startswith("#") and not line.rstrip().endswith(":"):
            key = line.split(":")[0].strip()
            assert "#" in line or key in ("red_gain", "blue_gain", "restitution", "rolling_friction", "spinning_friction"), line


@pytest.mark.parametrize("path", PATHS, ids=".".join)
def test_missing_and_senseless_values_are_refused(path):
    name = ".".join(path)
    for bad in ("fast", None, float("nan"), -1e9, True, [1.0]):
        with pytest.raises(InputError, match=name.replace(".", r"\.")):
            parse_model(changed(path, bad))
    values = changed(path, 1.0)
    place = values
    for key in path[:-1]:
        place = place[key]
    del place[path[-1]]
    with pytest.raises(InputError, match=f"'{name}' is missing"):
        parse_model(values)


def test_unknown_keys_effects_and_parameters_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"'arm\.stifness' is unknown"):
        parse_model(changed(("arm", "stifness"), 1.0))
    with pytest.raises(InputError, match="'winds' is unknown"):
        parse_model({**content(), "winds": {}})
    with pytest.raises(InputError, match="'arm' is no section"):
        parse_model({**content(), "arm": 3})
    with pytest.raises(InputError, match="'backlsh' is unknown"):
        parse_model({**content(), "effects": [{"name": "backlsh", "parameters": {}}]})
    for bad in (None, {"name": "x"}, [{"name": "x"}], ["x"]):
        with pytest.raises(InputError, match="effect"):
            parse_model({**content(), "effects": bad})
    with pytest.raises(InputError, match="no multiple"):
        model(timing__control_hz=30)
    for text in ("- 1", "a: [", ""):
        (tmp_path / "m.yaml").write_text(text)
        with pytest.raises(InputError, match=r"m\.yaml"):
            read_model(tmp_path / "m.yaml")
    with pytest.raises(InputError, match="cannot be read"):
        read_model(tmp_path / "none.yaml")


# The camera. A ramp of greys with a colour in every row.
IMAGE = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2).repeat(8, axis=0)


def seen(image=IMAGE, **changes) -> np.ndarray:
    camera = model(**{f"camera__{key}": value for key, value in changes.items()}).camera
    return respond(image, camera, np.random.default_rng(0))


def test_neutral_camera_changes_nothing():
    np.testing.assert_array_equal(seen(), IMAGE)
    # Through the table, too.
    assert np.abs(seen(gain=1 + 1e-12).astype(int) - IMAGE).max() == 0


def test_gain_acts_on_linear_light_and_clamps():
    linear = linear_from_srgb(seen(gain=2.0) / 255.0)
    expected = np.minimum(1.0, 2 * linear_from_srgb(IMAGE / 255.0))
    assert np.abs(linear - expected).max() < 0.005
    assert seen(gain=2.0)[0, -1, 0] == 255  # not wrapped around


@pytest.mark.parametrize(("key", "channel"), [("red_gain", 0), ("blue_gain", 2)])
def test_white_balance_moves_one_channel(key, channel):
    out = seen(**{key: 1.3})
    others = [c for c in range(3) if c != channel]
    np.testing.assert_array_equal(out[..., others], IMAGE[..., others])
    assert (out[:, 50:200, channel] > IMAGE[:, 50:200, channel]).all()


def test_gamma_and_black_level_act_on_the_code():
    assert seen(gamma=1.4)[0, 128, 0] == round(255 * (128 / 255) ** 1.4)
    assert seen(gamma=1.4)[0, 255, 0] == 255
    assert seen(black_level=0.1)[0, 0, 0] == round(25.5)
    assert seen(black_level=0.1)[0, 255, 0] == 255


@pytest.mark.parametrize(("key", "value"), [("shot_noise", 0.001), ("read_noise", 0.02)])
def test_noise_has_the_stated_spread(key, value):
    grey = np.full((200, 200, 3), 150, dtype=np.uint8)
    light = linear_from_srgb(seen(grey, **{key: value}) / 255.0)
    level = float(linear_from_srgb(np.array(150 / 255.0)))
    expected = np.sqrt(value * level) if key == "shot_noise" else value
    assert light.std() == pytest.approx(expected, rel=0.05)
    assert light.mean() == pytest.approx(level, abs=0.002)
    np.testing.assert_array_equal(seen(grey, **{key: value}), seen(grey, **{key: value}))


def test_file_is_plain_yaml():
    assert yaml.safe_load(NOMINAL.read_text())["effects"] == []
