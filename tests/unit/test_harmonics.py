"""Spherical harmonics: against scipy's, against autograd in float64, and turned with whatever carries them."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from gsbridge.cameras import Camera, camera_centre, look_at
from gsbridge.geometry import Similarity
from gsbridge.meshes import Mesh
from gsbridge.scene.editing import Composition
from gsbridge.scene.groups import GroupedComposition
from gsbridge.scene.view import draw, draw_seen
from gsbridge.splats.binding import create_binding, read_binding, write_binding
from gsbridge.splats.cloud import FIELDS, Cloud, concatenate
from gsbridge.splats.harmonics import TERMS, basis, degree_of, turned
from gsbridge.splats.rasterize import rasterize
from gsbridge.splats.rasterize.directional import view_colours, viewed

CAMERA = Camera(61, 54, 80.0, 82.0, 30.3, 26.7)
EYE = (0.3, 0.25, 0.4)
POSE = look_at(EYE, (0.0, 0.0, 0.0))


def directions(count: int, seed: int = 0) -> np.ndarray:
    values = np.random.default_rng(seed).normal(size=(count, 3))
    return values / np.linalg.norm(values, axis=1, keepdims=True)


def make_cloud(count: int, seed: int, degree: int, size: float = 0.15) -> Cloud:
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(count, 4))
    return Cloud(
        rng.uniform(-size, size, (count, 3)),
        quats / np.linalg.norm(quats, axis=1, keepdims=True),
        np.exp(rng.normal(np.log(0.01), 0.5, (count, 3))),
        rng.uniform(0.2, 0.95, count),
        rng.uniform(0.2, 0.9, (count, 3)),
        rng.normal(0, 0.15, (count, TERMS[degree], 3)),
    )


def tensors(cloud: Cloud, dtype: torch.dtype) -> list[torch.Tensor]:
    return [torch.from_numpy(getattr(cloud, name)).to(dtype).requires_grad_() for name in FIELDS]


def render(splats: list[torch.Tensor], backend: str) -> tuple[torch.Tensor, ...]:
    out = rasterize(*splats[:5], camera=CAMERA, cam_from_table=POSE, backend=backend, harmonics=splats[5])
    return out.colours, out.alphas, out.depths


def test_the_basis_is_the_real_part_of_scipys() -> None:
    d = directions(200)
    polar, azimuth = np.arccos(d[:, 2]), np.arctan2(d[:, 1], d[:, 0])
    expected = []
    for degree in (1, 2, 3):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), polar, azimuth)
            expected.append(np.sqrt(2) * value.imag if order < 0 else value.real * (np.sqrt(2) if order else 1))
    np.testing.assert_allclose(np.stack(basis(*d.T, 3)), np.stack(expected), atol=1e-12)
    assert len(basis(*d.T, 2)) == TERMS[2]


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_colours_and_gradients_of_the_kernels_equal_float64_autograd(degree: int) -> None:
    """Both in float64: only the formulas can differ. Some colours are clamped at zero."""
    cloud = make_cloud(50, degree, degree)
    found, true = ([tensors(cloud, torch.float64)[k] for k in (0, 4, 5)] for _ in range(2))
    with torch.no_grad():
        found[1][:10] -= 0.8
        true[1][:10] -= 0.8
    images = [view_colours(*group, np.array(EYE), kernels=kernels) for group, kernels in ((found, True), (true, False))]
    torch.testing.assert_close(images[0], images[1], atol=1e-13, rtol=0)
    assert 10 < int((images[0] == 0).sum()) < 60
    weights = torch.rand(50, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) - 0.3
    for got, expected in zip(*(torch.autograd.grad((i * weights).sum(), g) for i, g in zip(images, (found, true), strict=True)),
                             strict=True):  # fmt: skip
        torch.testing.assert_close(got, expected, atol=1e-12, rtol=1e-10)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_images_and_gradients_equal_the_reference_in_float64(degree: int) -> None:
    cloud = make_cloud(200, degree, degree)
    exact, fast = tensors(cloud, torch.float64), tensors(cloud, torch.float32)
    true, found = render(exact, "reference"), render(fast, "cpu")
    for image, other in zip(true, found, strict=True):
        assert float((image - other).abs().max()) < 5e-3
        assert int(((image - other).abs() > 3e-5).sum()) <= 3
    generator = torch.Generator().manual_seed(0)
    weights = [torch.rand(image.shape, generator=generator, dtype=torch.float64) - 0.3 for image in true]
    sums = [sum((i * w.to(i.dtype)).sum() for i, w in zip(images, weights, strict=True)) for images in (true, found)]
    for expected, got in zip(torch.autograd.grad(sums[0], exact), torch.autograd.grad(sums[1], fast), strict=True):
        assert float((expected - got).norm() / expected.norm()) < 1e-4


def test_without_harmonics_nothing_changes() -> None:
    cloud = make_cloud(100, 0, 0)
    splats = [tensor.detach() for tensor in tensors(cloud, torch.float32)]
    plain = rasterize(*splats[:5], camera=CAMERA, cam_from_table=POSE)
    for image, expected in zip(render(splats, "cpu"), (plain.colours, plain.alphas, plain.depths), strict=True):
        assert torch.equal(image, expected)
    assert viewed(cloud.means, cloud.colours, cloud.harmonics, np.array(EYE)) is cloud.colours


def test_broken_harmonics_leave_their_splat_out() -> None:
    cloud = make_cloud(30, 1, 1)
    broken = [tensor.detach().clone() for tensor in tensors(cloud, torch.float32)]
    broken[5][7, 1, 2] = float("nan")
    rest = [tensor.detach()[[k for k in range(30) if k != 7]] for tensor in tensors(cloud, torch.float32)]
    for backend in ("cpu", "reference"):
        for image, expected in zip(render(broken, backend), render(rest, backend), strict=True):
            torch.testing.assert_close(image, expected)


def test_wrong_harmonics_are_named() -> None:
    splats = tensors(make_cloud(5, 0, 1), torch.float32)
    with pytest.raises(ValueError, match="harmonics has shape"):
        render([*splats[:5], splats[5][:3]], "cpu")
    with pytest.raises(ValueError, match="belong to no degree"):
        render([*splats[:5], splats[5][:, :2]], "cpu")
    with pytest.raises(ValueError, match="belong to no degree"):
        Cloud(*(getattr(make_cloud(5, 0, 1), name) for name in FIELDS[:-1]), np.zeros((5, 4, 3)))
    assert [degree_of(terms) for terms in TERMS] == [0, 1, 2, 3]


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_turned_harmonics_show_the_turned_function(degree: int) -> None:
    rng = np.random.default_rng(degree)
    harmonics, rotations = rng.normal(size=(6, TERMS[degree], 3)), Rotation.random(6, rng).as_matrix()
    d = directions(40, degree)
    found = np.einsum("kd,nkc->ndc", np.stack(basis(*d.T, degree)), turned(harmonics, rotations))
    for one, rotation, colours in zip(harmonics, rotations, found, strict=True):
        expected = np.stack(basis(*(rotation.T @ d.T), degree)).T @ one
        np.testing.assert_allclose(colours, expected, atol=2e-6)
    np.testing.assert_allclose(turned(harmonics, rotations[0])[0], turned(harmonics, rotations)[0])


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_moved_body_looks_as_from_a_moved_camera(degree: int) -> None:
    """Cloud, both compositions: turning everything together changes no picture."""
    item, table = make_cloud(75, 3, degree, 0.05), make_cloud(60, 4, 0)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec((0.4, -1.1, 2.0)).as_matrix(), (0.03, -0.05, 0.02)
    moved = concatenate([item.transformed(Similarity.from_matrix(pose)), table])
    expected = draw(Composition({}, moved).splats, CAMERA, POSE, (0.1, 0.2, 0.3), 1)
    assert moved.sh_degree == degree
    still = draw(Composition({}, item).splats, CAMERA, POSE @ pose, (0.0, 0.0, 0.0), 1)[0]
    alone = draw(Composition({}, moved.subset(np.arange(75))).splats, CAMERA, POSE, (0.0, 0.0, 0.0), 1)[0]
    assert np.abs(still - alone).mean() < 1e-5
    whole, grouped = Composition({"item": item}, table), GroupedComposition({"item": item}, table)
    for _ in range(2):
        whole.pose({"item": np.eye(4)})
        whole.pose({"item": pose})
    np.testing.assert_allclose(whole.splats.harmonics[whole.part("item")], moved.harmonics[:75], atol=2e-6)
    seen = grouped.see({"item": pose}, CAMERA, POSE)
    for images in (
        draw(whole.splats, CAMERA, POSE, (0.1, 0.2, 0.3), 1),
        draw_seen(grouped.splats, seen, CAMERA, (0.1, 0.2, 0.3), 1),
    ):
        for image, other in zip(images, expected, strict=True):
            assert np.abs(image - other).mean() < 1e-5
            assert np.abs(image - other).max() < 6e-3
    plain = Cloud(*(getattr(item, name) for name in FIELDS[:-1]))
    dull = draw(Composition({"item": plain}, table).splats, CAMERA, POSE, (0.1, 0.2, 0.3), 1)[0]
    assert np.abs(dull - expected[0]).max() > 0.02
    with pytest.raises(ValueError, match="no room"):
        Composition({"item": plain}, table).reshape("item", item)


def test_harmonics_turn_with_the_faces_of_a_deformed_mesh(tmp_path) -> None:  # type: ignore[no-untyped-def]
    ball = trimesh.creation.icosphere(1, 0.05)
    binding = create_binding("soft", Mesh(np.asarray(ball.vertices), np.asarray(ball.faces)), 2, band=0.01, seed=0, sh_degree=2)
    rng = np.random.default_rng(0)
    binding.parameters["harmonics"] = torch.from_numpy(rng.normal(size=(len(binding), 8, 3)).astype(np.float32))
    write_binding(tmp_path / "binding.npz", binding)
    binding = read_binding(tmp_path / "binding.npz")
    rotation = Rotation.from_rotvec((0.3, 1.2, -0.7)).as_matrix()
    rest, found = binding.evaluate(), binding.evaluate(binding.vertices @ rotation.T)
    expected = rest.transformed(Similarity(1.0, rotation, np.zeros(3)))
    np.testing.assert_allclose(found.harmonics, expected.harmonics, atol=2e-5)
    np.testing.assert_array_equal(rest.harmonics, binding.parameters["harmonics"].numpy())
    np.testing.assert_allclose(
        viewed(found.means, found.colours, found.harmonics, rotation @ EYE),
        viewed(rest.means, rest.colours, rest.harmonics, camera_centre(POSE)),
        atol=2e-5,
    )
