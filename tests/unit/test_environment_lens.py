"""Image effects of a model in the pictures that a policy learns from."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from gsbridge.cameras import Camera
from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.registry import Applied
from gsbridge.environment.env import DrawnEye
from gsbridge.environment.lens import WristLens
from gsbridge.errors import InputError
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.scene.view import to_bytes
from gsbridge.sim.camera import respond
from gsbridge.sim.model import CameraModel, parse_model, read_model

NOMINAL = Path(__file__).resolve().parents[2] / "models" / "nominal.yaml"
CAMERA = Camera(16, 16, 20.0, 20.0, 8.0, 8.0)
RNG = np.random.default_rng(0)
IMAGE = RNG.integers(20, 200, (16, 16, 3)).astype(np.uint8)
VALUES = IMAGE.astype(np.float32) / np.float32(255.0)


class Room:
    """A world of which only the camera's place is asked."""

    def body_poses(self):
        return {}

    def camera_pose(self):
        return np.eye(4)


class Renderer:
    """Draws one picture and remembers from where."""

    camera = CAMERA

    def __init__(self, values=VALUES):
        self.values = values

    def render(self, body_poses, cam_from_table):
        return to_bytes(self.draw(body_poses, cam_from_table))

    def draw(self, body_poses, cam_from_table):
        self.pose = cam_from_table
        return self.values


def lens(name, **values):
    full = {p.name: 0.0 if p.amplitude else p.typical for p in IMAGE_EFFECTS[name].parameters} | values
    return WristLens([Applied(name, "", full)], CAMERA)


def test_without_effects_nothing_changes():
    plain = WristLens([], CAMERA)
    assert plain.plain
    assert np.array_equal(plain.photo(VALUES, np.eye(4), RNG), IMAGE)
    assert plain.camera == CAMERA
    pose = np.linalg.qr(RNG.normal(size=(4, 4)))[0]
    assert np.array_equal(plain.pose(pose), pose)


RAMP = np.linspace(-0.05, 1.05, 16 * 16 * 3, dtype=np.float32).reshape(16, 16, 3)
"""Values as splats may add up to: below black, above white, and between the bytes."""

CAMERAS = {
    "neutral": CameraModel(1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0),
    "calibrated": CameraModel(0.8, 1.15, 0.9, 1.1, 0.02, 0.0, 0.0),
    "dark": CameraModel(0.1, 1.2, 0.8, 1.3, -0.01, 0.0, 0.0),
    "noisy": CameraModel(0.9, 1.0, 1.0, 1.0, 0.0, 0.001, 0.01),
}

EFFECTS = {
    "exposure": {"stops": 2.5},
    "white_balance": {"red": 0.3, "blue": -0.2},
    "vignetting": {"strength": 0.6, "x": 0.0, "y": 0.0},
    "response": {"curve": -0.3},
    "black_level": {"level": 0.05},
}


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("made", [None, WristLens([], CAMERA)], ids=["no lens", "lens without effects"])
def test_without_effects_the_picture_is_the_rendered_one_to_the_bit(camera, made):
    """And behind a response what its table makes of the rendered bytes."""
    renderer, eye = Renderer(RAMP), DrawnEye(Renderer(RAMP), camera, made)
    eye.begin(5)
    drawn = renderer.render({}, np.eye(4))
    seen = eye.look(Room())
    assert np.array_equal(seen, respond(drawn, camera, np.random.default_rng(5)))
    if camera == CAMERAS["neutral"]:
        assert np.array_equal(seen, drawn)
        assert np.array_equal(DrawnEye(Renderer(RAMP), None, made).look(Room()), drawn)


def delivered(drawn, camera, rng):
    """The camera's response, written out in float64. Encoded, 0..1."""
    light = linear_from_srgb(np.clip(drawn.astype(np.float64), 0, 1)) * camera.gain * [camera.red_gain, 1.0, camera.blue_gain]
    if camera.shot_noise or camera.read_noise:
        light = light + np.sqrt(camera.shot_noise * light + camera.read_noise**2) * rng.standard_normal(light.shape)
    return np.clip(srgb_from_linear(np.clip(light, 0, 1)) ** camera.gamma + camera.black_level, 0, 1)


def developed(encoded, names):
    """Effects of `EFFECTS` on light and sensor, written out in float64. Encoded, 0..1."""
    light, have = linear_from_srgb(encoded), {name: EFFECTS[name] for name in names}
    if "vignetting" in have:
        across = (np.arange(16) + 0.5 - 8) / np.hypot(8, 8)
        light = light / ((1 + have["vignetting"]["strength"] * (across**2 + across[:, None] ** 2)) ** 2)[..., None]
    light = light * 2.0 ** have.get("exposure", {"stops": 0.0})["stops"]
    balance = have.get("white_balance", {"red": 0.0, "blue": 0.0})
    light = light * np.exp([balance["red"], 0.0, balance["blue"]])
    encoded = srgb_from_linear(np.clip(light, 0, 1)) ** np.exp(have.get("response", {"curve": 0.0})["curve"])
    return np.clip(encoded + have.get("black_level", {"level": 0.0})["level"], 0, 1)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("names", [*((name,) for name in EFFECTS), tuple(EFFECTS)], ids=[*EFFECTS, "all"])
def test_with_effects_the_picture_is_rounded_once(camera, names):
    """Within half a level of float64, as one rounding leaves it; rounded before each step, it would be up to seven off."""
    made = WristLens([Applied(name, "", EFFECTS[name]) for name in names], CAMERA)
    eye = DrawnEye(Renderer(RAMP), camera, made)
    eye.begin(7)
    seen = eye.look(Room()).astype(int)
    wanted = 255 * developed(delivered(RAMP, camera, np.random.default_rng(7)), names)
    assert np.abs(seen - np.floor(wanted + 0.5)).max() <= 1
    # Half a level, and what float32 loses.
    assert np.abs(seen - wanted).max() < 0.51


def test_noise_of_the_lens_falls_on_values_that_were_not_rounded():
    drawn, noisy = np.full((16, 16, 3), 100.3 / 255, np.float32), lens("noise", read=0.02)
    seen = noisy.photo(drawn, np.eye(4), np.random.default_rng(3))
    wanted = 100.3 + 255 * 0.02 * np.random.default_rng(3).standard_normal((16, 16, 3))
    assert np.abs(seen - wanted).max() < 0.51


def test_what_is_no_number_is_black():
    broken = VALUES.copy()
    broken[3, 4] = np.nan
    for made in (lens("focal", change=0.1), lens("exposure", stops=0.5)):
        for camera in (None, CAMERAS["neutral"], CAMERAS["calibrated"]):
            drawn = DrawnEye(Renderer(np.where(np.isnan(broken), np.float32(0.0), broken)), camera, made).look(Room())
            assert np.array_equal(DrawnEye(Renderer(broken), camera, made).look(Room()), drawn)


def test_white_balance_is_that_of_the_camera_response():
    seen = lens("white_balance", red=0.2, blue=-0.3).photo(VALUES, np.eye(4), RNG)
    camera = replace(read_model(NOMINAL).camera, red_gain=float(np.exp(0.2)), blue_gain=float(np.exp(-0.3)))
    assert np.abs(seen.astype(int) - respond(IMAGE, camera, RNG).astype(int)).max() <= 1


def test_vignetting_darkens_as_its_law_says():
    seen = lens("vignetting", strength=0.8).photo(VALUES, np.eye(4), RNG)
    across = (np.arange(16) + 0.5 - 8) / np.hypot(8, 8)
    law = 1.0 / (1.0 + 0.8 * (across**2 + across[:, None] ** 2)) ** 2
    light, before = (linear_from_srgb(image / 255.0) for image in (seen, IMAGE))
    np.testing.assert_allclose(light, before * law[..., None], atol=0.006)


def test_a_moved_camera_draws_from_elsewhere_and_a_longer_lens_draws_narrower():
    renderer = Renderer()
    moved = lens("extrinsics", y=0.015)
    assert np.array_equal(DrawnEye(renderer, None, moved).look(Room()), IMAGE)
    # The camera sits 15 mm further down its own image: everything else further up.
    np.testing.assert_allclose(renderer.pose[:3, 3], [0.0, -0.015, 0.0])
    assert lens("focal", change=0.1).camera.fx == pytest.approx(22.0)


def test_a_lens_that_bends_draws_wider_and_shows_what_the_projection_says():
    bending = lens("distortion", k1=0.3, k2=0.0)
    wide = bending.camera
    assert (wide.width, wide.fx) == (20, CAMERA.fx)
    # Grey that grows along the tangent of the angle, so that it tells which ray a pixel got.
    across = (np.arange(wide.width) + 0.5 - wide.cx) / wide.fx
    grey = ((128 + 100 * across) / 255).astype(np.float32)
    drawn = np.broadcast_to(grey[None, :, None], (wide.height, wide.width, 3))
    seen = bending.photo(drawn, np.eye(4), RNG)
    assert seen.shape == IMAGE.shape
    ray = (float(seen[8, 15, 0]) - 128) / 100
    radius = np.hypot(ray, 0.5 / CAMERA.fx)
    assert ray * (1 + 0.3 * radius**2) == pytest.approx(7.5 / CAMERA.fx, abs=0.015)


def test_a_shadow_stays_on_the_table():
    """From 0.3 m above, and from 0.1 m aside: the spot moves by the focal length times 0.1 over 0.3."""
    how = lens("shadow", strength=0.6, x=0.0, y=0.0, radius=0.03, softness=0.1)
    grey, middles = np.full((16, 16, 3), 128 / 255, np.float32), []
    for aside in (0.0, 0.05):
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = [-aside, 0.0, 0.3]
        dark = 128.0 - how.photo(grey, pose, RNG)[..., 0]
        middles.append((dark * (np.arange(16) + 0.5)).sum() / dark.sum())
    assert middles[0] == pytest.approx(8.0, abs=0.1)
    assert middles[1] - middles[0] == pytest.approx(-CAMERA.fx * 0.05 / 0.3, abs=0.25)


def test_noise_is_drawn_from_the_episodes_seed():
    noisy, renderer = lens("noise", read=0.03), Renderer()
    photos = []
    for seed in (1, 1, 2):
        eye = DrawnEye(renderer, None, noisy)
        eye.begin(seed)
        photos.append(eye.look(Room()))
    assert np.array_equal(photos[0], photos[1])
    assert not np.array_equal(photos[0], photos[2])
    assert (photos[0] / 255.0 - IMAGE / 255.0).std() == pytest.approx(0.03, rel=0.15)


@pytest.mark.parametrize("name", [name for name, effect in IMAGE_EFFECTS.items() if effect.amendable])
def test_every_effect_that_may_be_amended_shows(name):
    """In the picture, or in where and how wide the camera looks."""
    effect = IMAGE_EFFECTS[name]
    how = lens(name, **{p.name: 4 * p.typical for p in effect.parameters if p.amplitude})
    edge = (how.camera.width - CAMERA.width) // 2
    seen = how.photo(np.pad(VALUES, ((edge, edge), (edge, edge), (0, 0)), "edge"), np.eye(4), np.random.default_rng(1))
    elsewhere = np.abs(how.pose(np.eye(4)) - np.eye(4)).max() > 1e-3 or abs(how.camera.fx - CAMERA.fx) > 0.1
    assert elsewhere or np.abs(seen.astype(int) - IMAGE.astype(int)).max() >= 3


def test_models_hold_the_effects_that_can_be_drawn():
    content = yaml.safe_load(NOMINAL.read_text(encoding="utf-8"))
    good = content | {"effects": [{"name": "exposure", "parameters": {"stops": -0.5}}]}
    (effect,) = parse_model(good).effects
    assert (effect.name, dict(effect.parameters)) == ("exposure", {"stops": -0.5})
    for name, effect in IMAGE_EFFECTS.items():
        values = {p.name: p.typical for p in effect.parameters}
        model = content | {"effects": [{"name": name, "parameters": values}]}
        if effect.amendable:
            assert parse_model(model).effects[0].parameters == values
        else:
            with pytest.raises(InputError, match=effect.reason):
                parse_model(model)
    for name, parameters in (("latency", {"delay": 0.1}), ("exposure", {"stops": 9.0}), ("exposure", {})):
        with pytest.raises(InputError):
            parse_model(content | {"effects": [{"name": name, "parameters": parameters}]})
