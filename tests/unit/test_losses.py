"""The loss against scikit-image's SSIM and against plain torch with autograd in float64."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from skimage.metrics import structural_similarity

from gsbridge import logs
from gsbridge.splats.losses import l1_ssim


def make_pair(height: int, width: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A smooth image and a noisy copy."""
    rng = np.random.default_rng(seed)
    image = gaussian_filter(rng.uniform(size=(height, width, 3)), (1, 1, 0))
    return np.clip(image + rng.normal(0.0, 0.05, image.shape), 0, 1).astype(np.float32), image.astype(np.float32)


def plain_loss(image: torch.Tensor, target: torch.Tensor, weight: torch.Tensor, share: float) -> torch.Tensor:
    """The same loss from a dense 11x11 convolution."""
    taps = torch.exp(-0.5 * (torch.arange(-5, 6, dtype=image.dtype) / 1.5) ** 2)
    taps = taps / taps.sum()
    kernel = (taps[:, None] * taps)[None, None].repeat(3, 1, 1, 1)

    def blur(values: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.conv2d(values.permute(2, 0, 1)[None], kernel, padding=5, groups=3)[0].permute(1, 2, 0)

    mx, my = blur(image), blur(target)
    vx, vy, vxy = blur(image**2) - mx**2, blur(target**2) - my**2, blur(image * target) - mx * my
    ssim = (2 * mx * my + 1e-4) * (2 * vxy + 9e-4) / ((mx**2 + my**2 + 1e-4) * (vx + vy + 9e-4))
    total = 3 * weight.sum()
    weight = weight[..., None]
    return (1 - share) * (weight * (image - target).abs()).sum() / total + share * (1 - (weight * ssim).sum() / total)


def test_ssim_equals_scikit_image_away_from_the_border() -> None:
    image, target = make_pair(61, 47)
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": 1.0}
    _, full = structural_similarity(image.astype(float), target.astype(float), channel_axis=2, full=True, **options)
    inner = torch.zeros(61, 47)
    inner[5:-5, 5:-5] = 1.0
    found = 1.0 - float(l1_ssim(torch.from_numpy(image), torch.from_numpy(target), inner, ssim_weight=1.0))
    assert found == pytest.approx(full[5:-5, 5:-5].mean(), abs=1e-5)


@pytest.mark.parametrize("size", [(61, 47), (7, 5), (16, 64)])
@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_value_and_gradient_equal_float64_autograd(size: tuple[int, int], share: float) -> None:
    image, target = make_pair(*size, seed=1)
    weight = torch.from_numpy(np.random.default_rng(2).uniform(size=size))
    fast = torch.tensor(image, requires_grad=True)
    exact = torch.tensor(image, dtype=torch.float64, requires_grad=True)
    found = l1_ssim(fast, torch.from_numpy(target), weight.float(), share)
    true = plain_loss(exact, torch.from_numpy(target).double(), weight, share)
    assert float(found) == pytest.approx(float(true), abs=1e-6)
    (2.0 * found).backward()
    (2.0 * true).backward()
    assert float((fast.grad - exact.grad).norm() / exact.grad.norm()) < 1e-4


def test_no_weight_means_equal_weights() -> None:
    image, target = (torch.from_numpy(array) for array in make_pair(20, 30))
    assert float(l1_ssim(image, target)) == pytest.approx(float(l1_ssim(image, target, torch.full((20, 30), 0.5))), rel=1e-6)


def test_equal_images_have_no_loss_and_no_gradient() -> None:
    image, _ = make_pair(24, 24)
    tensor = torch.tensor(image, requires_grad=True)
    loss = l1_ssim(tensor, torch.from_numpy(image))
    loss.backward()
    assert abs(float(loss)) < 1e-6
    assert float(tensor.grad.abs().max()) < 1e-6


def test_no_weight_at_all_gives_zero() -> None:
    image, target = (torch.from_numpy(array) for array in make_pair(16, 16))
    image.requires_grad_()
    loss = l1_ssim(image, target, torch.zeros(16, 16))
    loss.backward()
    assert float(loss) == 0.0
    assert not bool(image.grad.any())


def test_two_threads_give_the_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    image, target = make_pair(45, 33)
    results = []
    for count in (1, 2):
        monkeypatch.setattr(logs, "threads", lambda count=count: count)
        tensor = torch.tensor(image, requires_grad=True)
        loss = l1_ssim(tensor, torch.from_numpy(target))
        loss.backward()
        results.append((float(loss), tensor.grad))
    assert results[0][0] == results[1][0]
    assert torch.equal(results[0][1], results[1][1])


def test_shapes_must_fit() -> None:
    image = torch.zeros(8, 9, 3)
    with pytest.raises(ValueError, match="must both be"):
        l1_ssim(image, torch.zeros(8, 8, 3))
    with pytest.raises(ValueError, match="weight has shape"):
        l1_ssim(image, image, torch.zeros(9, 8))
