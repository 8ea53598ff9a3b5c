"""The rasteriser against closed forms and against plain torch with autograd in float64."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from gsbridge import logs
from gsbridge.cameras import Camera, look_at
from gsbridge.errors import InputError
from gsbridge.splats.rasterize import blending, cpu, rasterize, reference
from gsbridge.splats.rasterize.layout import STATE

CAMERA = Camera(71, 58, 90.0, 92.0, 35.3, 28.7)  # no multiple of a block, principal point off the centre
POSE = look_at((0.3, 0.25, 0.4), (0.0, 0.0, 0.0))
BACKGROUND = (0.2, 0.5, 0.9)


def make_splats(count: int, seed: int, dtype: torch.dtype = torch.float32) -> list[torch.Tensor]:
    """Splats of many shapes in a box before the camera; the same numbers for every dtype."""
    rng = np.random.default_rng(seed)
    arrays = (
        rng.uniform(-0.15, 0.15, (count, 3)),
        rng.normal(size=(count, 4)),
        np.exp(rng.normal(np.log(0.01), 0.6, (count, 3))),
        rng.beta(2.5, 1.0, count),
        rng.uniform(size=(count, 3)),
    )
    return [torch.tensor(array, dtype=torch.float32).to(dtype).requires_grad_() for array in arrays]


def draw(splats: list[torch.Tensor], backend: str = "cpu", camera: Camera = CAMERA, pose=POSE) -> tuple[torch.Tensor, ...]:  # type: ignore[no-untyped-def]
    """Colour, alpha and depth images."""
    out = rasterize(
        *splats, camera=camera, cam_from_table=pose, background=torch.tensor(BACKGROUND, dtype=splats[0].dtype), backend=backend
    )
    return out.colours, out.alphas, out.depths


def gradients(splats: list[torch.Tensor], images: tuple[torch.Tensor, ...], seed: int = 0) -> list[torch.Tensor]:
    """Gradients of a random weighting of all three images."""
    generator = torch.Generator().manual_seed(seed)
    weights = [torch.rand(image.shape, generator=generator, dtype=torch.float64) - 0.3 for image in images]
    loss = sum((image * weight.to(image.dtype)).sum() for image, weight in zip(images, weights, strict=True))
    return list(torch.autograd.grad(loss, splats))


def one_splat(mean=(0.0, 0.0, 1.0), scale=0.02, opacity=0.7, colour=(1.0, 0.5, 0.25)) -> list[torch.Tensor]:  # type: ignore[no-untyped-def]
    """A ball of Gaussian density."""
    return [
        torch.tensor([mean], dtype=torch.float32),
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        torch.full((1, 3), scale),
        torch.tensor([opacity], dtype=torch.float32),
        torch.tensor([colour], dtype=torch.float32),
    ]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_images_and_gradients_equal_float64_autograd(seed: int) -> None:
    exact, fast = make_splats(300, seed, torch.float64), make_splats(300, seed)
    true, found = draw(exact, "reference"), draw(fast)
    for image, other in zip(true, found, strict=True):
        # float32 leaves about 1e-6; a splat within rounding of the cut may put 1/255 into a pixel or two.
        difference = (image - other).abs()
        assert float(difference.max()) < 5e-3
        assert int((difference > 2e-5).sum()) <= 3
    for expected, got in zip(gradients(exact, true), gradients(fast, found), strict=True):
        assert float((expected - got).norm() / expected.norm()) < 1e-4


def test_large_splats_are_listed_in_every_block_they_meet() -> None:
    exact, fast = make_splats(12, 5, torch.float64), make_splats(12, 5)
    for group in (exact, fast):
        group[2] = (group[2].detach() * torch.tensor([12.0, 1.5, 3.0])).requires_grad_()
        group[3] = (group[3].detach() * 0.3).requires_grad_()
    true, found = draw(exact, "reference"), draw(fast)
    assert float((true[0] - found[0]).abs().max()) < 5e-3
    assert float((true[1] - found[1]).abs().mean()) < 1e-6
    for expected, got in zip(gradients(exact, true), gradients(fast, found), strict=True):
        assert float((expected - got).norm() / expected.norm()) < 1e-4


def test_a_ball_on_the_axis_has_the_closed_form() -> None:
    camera = Camera(33, 33, 100.0, 100.0, 16.5, 16.5)
    colours, alphas, depths = draw(one_splat(scale=0.02), camera=camera, pose=np.eye(4))
    offset = np.arange(33) - 16.0
    square = offset[:, None] ** 2 + offset[None, :] ** 2
    # The ball's variance on the screen: (focal * sigma / z)^2 and the blur.
    expected = 0.7 * np.exp(-0.5 * square / (2.0**2 + 0.3))
    expected[expected < 1 / 255] = 0.0
    assert np.abs(alphas.numpy() - expected).max() < 1e-6
    assert np.abs(depths.numpy() - expected).max() < 1e-6
    blend = expected[..., None] * [1.0, 0.5, 0.25] + (1 - expected[..., None]) * BACKGROUND
    assert np.abs(colours.numpy() - blend).max() < 1e-6


def test_the_nearer_splat_covers_and_ties_go_by_number() -> None:
    near, far = one_splat((0.0, 0.0, 0.9), 0.05, 0.9, (1, 0, 0)), one_splat((0.0, 0.0, 1.1), 0.05, 0.9, (0, 1, 0))
    camera = Camera(9, 9, 20.0, 20.0, 4.5, 4.5)
    for pair, first in (((far, near), 0), ((near, far), 0)):
        both = [torch.cat(parts) for parts in zip(*pair, strict=True)]
        pixel = draw(both, camera=camera, pose=np.eye(4))[0][4, 4]
        assert pixel[first] > 0.85
        assert pixel[1 - first] < 0.1
    tie = [torch.cat(parts) for parts in zip(one_splat(colour=(1, 0, 0)), one_splat(colour=(0, 1, 0)), strict=True)]
    pixel = draw(tie, camera=camera, pose=np.eye(4))[0][4, 4]
    assert pixel[0] > pixel[1] + 0.2


def test_splats_with_broken_numbers_are_left_out() -> None:
    splats = make_splats(60, 3)
    broken = [group.detach().clone() for group in splats]
    broken[0][0, 1], broken[1][7], broken[2][13, 0] = float("nan"), 0.0, float("inf")
    broken[3][21], broken[4][33, 2], broken[0][40, 2] = float("nan"), float("inf"), float("-inf")
    broken = [group.requires_grad_() for group in broken]
    kept = [k for k in range(60) if k not in (0, 7, 13, 21, 33, 40)]
    images = draw(broken)
    for image, expected in zip(images, draw([group.detach()[kept] for group in splats]), strict=True):
        assert torch.equal(image, expected)
    for gradient in gradients(broken, images):
        assert bool(torch.isfinite(gradient).all())
        assert not bool(gradient[[0, 7, 13, 21, 33, 40]].any())


def test_extreme_splats_stay_finite_and_inside_the_image() -> None:
    splats = make_splats(40, 4)
    with torch.no_grad():
        splats[2][:10] *= 1e5  # far larger than the image
        splats[2][10:20] *= 1e-6  # far smaller than a pixel
        eye = torch.tensor([0.3, 0.25, 0.4])
        splats[0][20:30] = eye * (1 - torch.linspace(0.021, 0.1, 10))[:, None]  # nearly in the camera
        splats[0][30:40] = eye * 1.5  # behind it
    images = draw(splats)
    assert all(bool(torch.isfinite(image).all()) for image in images)
    assert float(images[1].min()) >= 0.0
    assert float(images[1].max()) <= 1.0
    found = gradients(splats, images)
    assert all(bool(torch.isfinite(gradient).all()) for gradient in found)
    assert not bool(found[0][30:40].any())


@pytest.mark.parametrize("mean", [(0.0, 0.0, -1.0), (50.0, 0.0, 1.0), (0.0, 0.0, 0.005)])
def test_nothing_in_view_gives_the_background(mean: tuple[float, float, float]) -> None:
    colours, alphas, depths = draw(one_splat(mean), pose=np.eye(4))
    assert torch.equal(colours, torch.tensor(BACKGROUND).expand_as(colours))
    assert not bool(alphas.any())
    assert not bool(depths.any())


def test_no_splats_at_all() -> None:
    empty = [group[:0].detach().requires_grad_() for group in make_splats(1, 0)]
    images = draw(empty)
    assert float(images[1].max()) == 0.0
    assert [tuple(gradient.shape) for gradient in gradients(empty, images)] == [(0, 3), (0, 4), (0, 3), (0,), (0, 3)]


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_give_the_same_image_and_gradients(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit: bands of rows add up the gradients of a splat on their border in the order of one thread."""
    splats = make_splats(400, 6)
    one = draw(splats)
    again = draw(splats)
    first = gradients(splats, one)
    assert all(torch.equal(a, b) for a, b in zip(first, gradients(splats, again), strict=True))
    monkeypatch.setattr(logs, "threads", lambda: threads)
    more = draw(splats)
    assert all(torch.equal(a, b) for a, b in zip(one, more, strict=True))
    assert all(torch.equal(a, b) for a, b in zip(first, gradients(splats, more), strict=True))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_both_kernels_of_a_block_blend_alike(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    given = []

    def kept(blocks: tuple, images: tuple) -> None:
        given.extend(array.copy() if isinstance(array, np.ndarray) else array for array in blocks)

    monkeypatch.setattr(blending, "blend", kept)
    cpu.render(*(tensor.detach().numpy() for tensor in make_splats(800, seed)), camera=CAMERA, cam_from_table=POSE, threads=1)
    table, records, entries, starts, ends, rows, columns, *size, background, _ = given
    found = []
    for kernel in (blending._blend_block, blending._blend_block_wide):
        lists, states = entries.copy(), np.zeros(rows * columns * STATE, np.float32)
        weights = np.empty(16 * (1 + max(ends[: rows * columns] - starts[: rows * columns])), np.float32)
        for block in range(rows * columns):
            first, last, place = starts[block], ends[block], divmod(block, columns)
            end = kernel(table, records, lists, first, last, *place, *size, background, states, block * STATE, weights)
            found.append(lists[first:end].tolist())
        given.append(states)
    half = len(found) // 2
    assert sum(map(len, found)) > 1000
    # Rounding may decide whether a splat at the cut counts, which is worth 1/255.
    assert sum(a != b for a, b in zip(found[:half], found[half:], strict=True)) <= 2
    assert np.median(np.abs(given[-1] - given[-2])) < 1e-7
    np.testing.assert_allclose(given[-1], given[-2], atol=5e-3)


def test_renderings_keep_their_own_work_space() -> None:
    splats = make_splats(200, 7)
    alone = gradients(splats, draw(splats))
    waiting = draw(splats)
    draw(make_splats(900, 8), pose=look_at((0.1, -0.4, 0.3), (0.0, 0.0, 0.0)))
    for a, b in zip(alone, gradients(splats, waiting), strict=True):
        assert torch.equal(a, b)


def test_render_is_rasterize_without_gradients() -> None:
    splats = make_splats(203, 9)  # no multiple of the lanes
    arrays = [group.detach().numpy() for group in splats]
    images = cpu.render(*arrays, camera=CAMERA, cam_from_table=POSE, background=np.array(BACKGROUND), threads=1)
    for image, expected in zip(images, draw(splats), strict=True):
        assert np.array_equal(image, expected.detach().numpy())


def test_tiles_of_the_reference_change_nothing() -> None:
    splats = [group.detach() for group in make_splats(80, 10, torch.float64)]
    whole = reference.rasterize(*splats, CAMERA, POSE, None, 0.01)
    tiled = reference.rasterize(*splats, CAMERA, POSE, None, 0.01, tile=16)
    for a, b in zip(whole, tiled, strict=True):
        assert float((a - b).abs().max()) < 1e-12


def test_wrong_arguments_are_named() -> None:
    splats = make_splats(4, 0)
    with pytest.raises(InputError, match="unknown backend"):
        draw(splats, "vulkan")
    with pytest.raises(ValueError, match="quats has shape"):
        draw([splats[0], splats[1][:3], *splats[2:]])
    with pytest.raises(ValueError, match="distortion"):
        draw(splats, camera=Camera(8, 8, 9.0, 9.0, 4.0, 4.0, (0.1, 0.0, 0.0, 0.0)))


def test_cuda_without_a_device_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match="Use 'cpu'"):
        draw(make_splats(4, 0), "cuda")
