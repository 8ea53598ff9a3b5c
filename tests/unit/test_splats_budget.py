"""The number of splats that `max_splats: auto` chooses: against ramps and squares whose answers are formulas."""

import numpy as np
import pytest

from gsbridge.cameras import Camera, look_at
from gsbridge.configuration.splats import SplatSettings
from gsbridge.meshes import Mesh
from gsbridge.splats.budget import LEAST, TEXTURE_PSNR, choose_splats, surface_pixels, texture_width
from gsbridge.splats.targets import Target

SIZE, FOCAL, HEIGHT, HALF = 240, 300.0, 0.5, 0.15
CAMERA = Camera(SIZE, SIZE, FOCAL, FOCAL, SIZE / 2, SIZE / 2)


def square(count: int = 31) -> Mesh:
    """A square of the table, facing up."""
    x = np.linspace(-HALF, HALF, count)
    grid = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((count, count))], axis=-1).reshape(-1, 3)
    a = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    return Mesh(grid, np.concatenate([np.c_[a, a + count, a + 1], np.c_[a + 1, a + count, a + count + 1]]))


def photo_from_above(colour, split: str = "train") -> Target:
    """A photo that looks straight down on the square; `colour` [H, W] 0..1."""
    pose = look_at(np.array([0.0, 0.0, HEIGHT]), np.zeros(3), np.array([0.0, 1.0, 0.0]))
    photo = np.repeat(np.rint(255 * colour)[..., None], 3, axis=2).astype(np.uint8)
    reach = np.abs(np.arange(SIZE) + 0.5 - SIZE / 2) < HALF * FOCAL / HEIGHT
    weight = np.where(reach[:, None] & reach, 255, 0).astype(np.uint8)
    return Target("a", split, CAMERA, pose, photo, weight, photo, 0, 0, CAMERA)


def ramp(slope: float):
    """Brightness that rises by `slope` per pixel, and falls again where it would leave 0..1."""
    return np.repeat(np.abs((slope * np.arange(SIZE) + 1) % 2 - 1)[None], SIZE, axis=0)


def test_pixels_of_a_surface_seen_head_on_are_those_of_its_picture():
    mesh, target = square(), photo_from_above(ramp(0.0))
    found = surface_pixels(mesh, [target, target], np.ones(len(mesh.faces), bool))
    assert found == pytest.approx((2 * HALF * FOCAL / HEIGHT) ** 2, rel=1e-6)
    assert found == pytest.approx((target.weight > 0).sum(), rel=0.02)
    half = mesh.corners().mean(1)[:, 0] < 0
    assert surface_pixels(mesh, [target], half) == pytest.approx(found / 2, rel=1e-6)


@pytest.mark.parametrize("slope", [0.008, 0.016, 0.03])
def test_width_of_a_ramp_follows_from_its_slope(slope):
    """The variance of a ramp within w pixels is slope^2 (w^2 - 1) / 12."""
    error = 10 ** (-TEXTURE_PSNR / 10)
    expected = np.sqrt(1 + 12 * error / slope**2)
    assert texture_width([photo_from_above(ramp(slope))]) == pytest.approx(expected, rel=0.1)


def test_texture_and_bounds_decide_the_number():
    mesh = square()
    settings = SplatSettings(max_splats="auto", max_pixels=SIZE * SIZE, most_splats=30_000)
    rng = np.random.default_rng(0)
    plain, rich = np.full((SIZE, SIZE), 0.5), rng.random((SIZE, SIZE))
    hidden = photo_from_above(rich, split="held_out")
    assert choose_splats(mesh, [photo_from_above(plain), hidden], settings, kind="object") == LEAST
    assert choose_splats(mesh, [photo_from_above(rich)], settings, kind="object") == pytest.approx(30_000, rel=0.1)
    few = settings.model_copy(update={"most_splats": 5_000})
    assert choose_splats(mesh, [photo_from_above(rich)], few, kind="object") == 5_000
