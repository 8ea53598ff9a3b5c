"""Image metrics and codecs against scikit-image and closed forms."""

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from gsbridge.errors import InputError
from gsbridge.images import (
    linear_from_srgb,
    psnr,
    read_image,
    read_mask,
    srgb_from_linear,
    ssim_map,
    to_u8,
    write_image,
)


@pytest.fixture
def pair():
    rng = np.random.default_rng(0)
    image = rng.uniform(size=(40, 50, 3))
    return image, np.clip(image + rng.normal(scale=0.05, size=image.shape), 0, 1)


def test_psnr_agrees_with_scikit_image(pair):
    assert psnr(*pair) == pytest.approx(peak_signal_noise_ratio(pair[1], pair[0], data_range=1.0))


def test_masked_psnr_counts_masked_pixels_only(pair):
    image, other = pair[0].copy(), pair[1]
    mask = np.zeros(image.shape[:2])
    mask[5:20, 5:20] = 1
    expected = peak_signal_noise_ratio(other[5:20, 5:20], image[5:20, 5:20], data_range=1.0)
    image[30:] = 0
    assert psnr(image, other, mask) == pytest.approx(expected)
    assert np.isnan(psnr(image, other, np.zeros_like(mask)))
    assert psnr(image, image) == np.inf


def test_ssim_agrees_with_scikit_image_inside(pair):
    full = structural_similarity(
        *pair, channel_axis=2, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1.0, full=True
    )[1].mean(-1)
    np.testing.assert_allclose(ssim_map(*pair)[6:-6, 6:-6], full[6:-6, 6:-6], atol=1e-6)


def test_srgb_round_trip_and_known_values():
    values = np.linspace(0, 1, 101)
    np.testing.assert_allclose(srgb_from_linear(linear_from_srgb(values)), values, atol=1e-6)
    # Half the light is encoded as 0.735, the reason why tags are sought in linear light.
    assert srgb_from_linear(np.array(0.5)) == pytest.approx(0.7354, abs=1e-4)


def test_values_are_clamped_before_they_become_bytes():
    np.testing.assert_array_equal(to_u8(np.array([-0.2, 0.5, 1.3])), [0, 128, 255])


def test_image_files(tmp_path):
    image = np.random.default_rng(1).uniform(size=(5, 7, 3)).astype(np.float32)
    write_image(tmp_path / "a.png", image)
    np.testing.assert_allclose(read_image(tmp_path / "a.png"), image, atol=0.5 / 255 + 1e-6)
    write_image(tmp_path / "m.png", image[..., 0])
    np.testing.assert_allclose(read_mask(tmp_path / "m.png"), image[..., 0], atol=0.5 / 255 + 1e-6)
    with pytest.raises(InputError, match="does not exist"):
        read_image(tmp_path / "none.png")
    (tmp_path / "text.png").write_text("this is text")
    with pytest.raises(InputError, match="not a readable image"):
        read_image(tmp_path / "text.png")
