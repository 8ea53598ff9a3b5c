"""What actor and critics see, augmentation, networks, settings."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from environment_fixture import PLATE, HandWorld
from policy_fixture import CONTROLLER, blob_environment, blob_observer

from gsbridge.configuration.policy import PolicySettings
from gsbridge.errors import InputError
from gsbridge.policy.augment import Augmentation, Augmenter, Jitter, colour_maps
from gsbridge.policy.networks import LOG_STD, Actor, Critics, SoftArgmax
from gsbridge.policy.observation import PRIVILEGED, ObservedFrame, actor_input, picture, position_label, privileged


def state(**values):
    world = HandWorld()
    for name, value in values.items():
        setattr(world, name, value)
    return world.state()


def test_privileged_vector_by_its_table():
    world = state(
        tool=np.array([0.03, 0.295, 0.15]), yaw=0.4, aperture=0.07, cube=np.array([-0.03, 0.265, 0.05]), cube_yaw=-0.3
    )
    proprio = np.arange(12, dtype=np.float32)[None] / 10
    frame = ObservedFrame((0.0, 0.265), 0.14, (0.02, 0.285), 4)
    (vector,) = privileged(world, proprio, frame, np.array([[3.0, 1.0]]))
    expected = [
        *(0.2, 0.2, 1.0, np.sin(0.4), np.cos(0.4), 0.5, 0, 0),
        *(-0.4, -0.2, -2 / 3, np.sin(-0.3), np.cos(-0.3), 0, 0, 0.5, 0, 0, 0),
        *(0, np.tanh(1.1 / 20), 1 / 3, 2 / 15, 0.75, 1.0),
        *(0.6, 0.7, 0.8, 0.9, 1.0),
    ]
    np.testing.assert_allclose(vector, expected, atol=1e-6)
    assert vector.shape == (PRIVILEGED,)
    assert vector.dtype == np.float32


def test_position_label_is_in_the_tools_yaw():
    world = state(tool=np.array([0.0, 0.2, 0.1]), yaw=np.pi / 2, cube=np.array([0.03, 0.25, 0.0]))
    np.testing.assert_allclose(position_label(world)[0], [0.5, -0.3, -1.0], atol=1e-6)


def test_a_broken_world_gives_finite_vectors():
    world = state(broken=True)
    assert np.isfinite(privileged(world, np.zeros((1, 12)), ObservedFrame((0, 0), 0.14))).all()
    assert np.isfinite(position_label(world)).all()


def test_observer_labels_with_the_controller_and_knows_the_tasks_memory():
    environment = blob_environment(task="pick_and_place", plate=PLATE)
    observer = blob_observer(environment)
    assert observer.frame == ObservedFrame((0.0, 0.265), 0.14, (PLATE.x, PLATE.y), environment.rules.settle_steps)
    observation, info = environment.reset(seed=0)
    info["terms"] = {**info["terms"], "streak": 2.0, "excess": 1.0}
    sight = observer(observation, info)
    np.testing.assert_allclose(sight.privileged[23:25], [2 / environment.rules.settle_steps, 1.0])
    world = environment.world.state()
    np.testing.assert_array_equal(sight.base, CONTROLLER(world)[0])
    np.testing.assert_array_equal(sight.image, observation["image"])


def test_picture_scale_and_layout():
    image = torch.tensor([[[[0, 51, 255], [255, 0, 102]]]], dtype=torch.uint8)
    out = picture(image)
    assert out.shape == (1, 3, 1, 2)
    torch.testing.assert_close(out[0, :, 0, 0], torch.tensor([-0.5, -0.3, 0.5]))
    torch.testing.assert_close(out[0, :, 0, 1], torch.tensor([0.5, -0.5, -0.1]))


@pytest.mark.parametrize(
    "change",
    [
        {"image": np.zeros((64, 64, 3), np.float32)},
        {"image": np.zeros((32, 64, 3), np.uint8)},
        {"proprio": np.zeros(10)},
        {"proprio": np.full(12, np.nan)},
    ],
)
def test_actor_refuses_other_observations(change):
    with pytest.raises(InputError):
        actor_input({"image": np.zeros((64, 64, 3), np.uint8), "proprio": np.zeros(12), **change}, 64)


def pictures(count=16, size=12):
    image = np.random.default_rng(0).integers(0, 256, (count, size, size, 3)).astype(np.uint8)
    return picture(torch.from_numpy(image))


NOTHING = Jitter(0.0, 0.0, 0.0, 0.0, 0.0)


def test_augmentation_of_no_strength_changes_nothing():
    before = pictures()
    after = Augmenter(Augmentation(NOTHING, 0.0, 0.0))(before, torch.Generator().manual_seed(0))
    torch.testing.assert_close(after, before, atol=1e-6, rtol=0)


def test_augmentation_by_seed_stays_in_range_and_keeps_the_layout():
    augmenter, before = Augmenter(), pictures()
    first, second, other = (augmenter(before, torch.Generator().manual_seed(seed)) for seed in (1, 1, 2))
    assert torch.equal(first, second)
    assert not torch.equal(first, other)
    assert float(first.abs().max()) <= 0.5
    assert first.shape == before.shape
    assert first.is_contiguous(memory_format=torch.channels_last)
    torch.testing.assert_close(before, pictures())


def test_each_attribute_does_what_it_says():
    generator = torch.Generator().manual_seed(3)
    rgb = torch.tensor([0.2, 0.5, 0.7])

    def maps(offset=0.0, **ranges):
        matrix, shift = colour_maps(Augmentation(replace(NOTHING, **ranges), offset), 400, generator)
        return matrix @ (rgb - 0.5) + shift + 0.5

    bright = maps(brightness=0.4) / rgb
    torch.testing.assert_close(bright, bright[:, :1].expand(-1, 3))
    assert 0.6 <= float(bright.min()) < 0.65
    assert 1.35 < float(bright.max()) <= 1.4
    steep = (maps(contrast=0.4) - 0.5)[:, ::2] / (rgb - 0.5)[::2]
    torch.testing.assert_close(steep[:, 0], steep[:, 1])
    grey = torch.tensor([0.299, 0.587, 0.114])
    pale = maps(saturation=0.4)
    torch.testing.assert_close(pale @ grey, (rgb @ grey).expand(400))
    turned = maps(hue_deg=20.0)
    torch.testing.assert_close(turned.sum(1), rgb.sum().expand(400))
    torch.testing.assert_close(turned.norm(dim=1), rgb.norm().expand(400))
    assert 0.05 < float((turned - rgb).abs().max()) < 0.3
    tint = maps(tint=0.2) / rgb
    assert float(tint.std(0).min()) > 0.08
    shift = maps(offset=0.05) - rgb
    assert 0.04 < float(shift.abs().max()) <= 0.05 + 1e-6


def test_noise_has_the_asked_strength():
    grey = torch.zeros(500, 3, 12, 12).contiguous(memory_format=torch.channels_last)
    out = Augmenter(Augmentation(NOTHING, 0.0, 0.1))(grey, torch.Generator().manual_seed(0))
    sigma = out.flatten(1).std(1)
    assert float(sigma.mean()) == pytest.approx(0.05, rel=0.1)
    assert float(sigma.max()) < 0.115


def test_only_the_opening_is_noisy_in_proprio():
    felt = Augmenter(Augmentation(opening=(0.02, 0.07))).feel(torch.zeros(4000, 12), torch.Generator().manual_seed(0))
    expected = torch.zeros(12)
    expected[5], expected[10] = 0.02, 0.07
    torch.testing.assert_close(felt.std(0), expected, rtol=0.05, atol=0)


@pytest.mark.parametrize("values", [{"noise": -0.1}, {"offset": 0.9}, {"opening": (0.1, -0.1)}])
def test_augmentation_refuses(values):
    with pytest.raises(InputError):
        Augmentation(**values)


def test_soft_argmax_finds_a_peak():
    features = torch.zeros(1, 2, 5, 9)
    features[0, 0, 1, 6] = features[0, 1, 4, 0] = 50.0
    out = SoftArgmax()(features)[0]
    torch.testing.assert_close(out, torch.tensor([0.5, -0.5, -1.0, 1.0, 50.0, 50.0]), atol=1e-5, rtol=0)


@pytest.mark.parametrize("size", [64, 128])
def test_networks_have_the_stated_shapes(size):
    actor = Actor()
    pi, position = actor(torch.rand(2, 3, size, size) - 0.5, torch.zeros(2, 12))
    assert pi.mean.shape == pi.log_std.shape == (2, 5)
    assert position.shape == (2, 3)
    assert bool(((pi.log_std >= LOG_STD[0]) & (pi.log_std <= LOG_STD[1])).all())
    assert Actor(with_position=False)(torch.zeros(1, 3, size, size), torch.zeros(1, 12))[1] is None
    critics = Critics(bounded=True)
    first, second = critics(100 * torch.randn(50, PRIVILEGED), torch.zeros(50, 5))
    assert bool(((first >= 0) & (first <= 1)).all())
    assert not torch.equal(first, second)


def test_every_setting_is_checked():
    for name in PolicySettings.model_fields:
        for wrong in (None, "x", -1e9, float("nan")):
            with pytest.raises(InputError, match=name):
                PolicySettings(**{name: wrong})


@pytest.mark.parametrize(
    "values", [{"critic_batch": 16}, {"alpha_start": 0.1}, {"eval_poses": 30}, {"steps": True}, {"image_size": 100}]
)
def test_settings_that_do_not_fit_together(values):
    with pytest.raises(InputError):
        PolicySettings(**values)


def test_share_of_the_controller():
    settings = PolicySettings(steps=1000, lambda_share=0.5, lambda_floor=0.2)
    assert [settings.lambda_at(step) for step in (0, 250, 500, 900)] == pytest.approx([1.0, 0.6, 0.2, 0.2])
    assert settings.model_copy(update={"algo": "bc"}).lambda_at(900) == 1.0
    assert settings.model_copy(update={"algo": "sac"}).lambda_at(0) == 0.0
    assert settings.model_copy(update={"algo": "sac", "target": "paper"}).maximum == "none"


@pytest.mark.parametrize("values", [{"brightness": 1.0}, {"hue_deg": float("nan")}, {"tint": -0.1}])
def test_ranges_of_attributes_that_make_no_sense_are_refused(values):
    with pytest.raises(InputError, match="out of range"):
        Jitter(**values)
