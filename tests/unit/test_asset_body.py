"""Mass properties against solids with closed forms and against trimesh; frames, widths, densities."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.asset.body import body_from_table, mass_properties, narrowest_width
from gsbridge.asset.density import DENSITIES
from gsbridge.configuration.asset import AssetSettings
from gsbridge.errors import InputError
from gsbridge.meshes import Mesh


def mesh_of(shape: trimesh.Trimesh, offset=(0.0, 0.0, 0.0)) -> Mesh:
    return Mesh(np.asarray(shape.vertices) + np.asarray(offset), np.asarray(shape.faces, np.int64))


def test_box():
    a, b, c = 0.04, 0.06, 0.1
    found = mass_properties(mesh_of(trimesh.creation.box((a, b, c)), (0.3, -0.2, 0.05)), 500.0)
    mass = 500.0 * a * b * c
    assert found.volume == pytest.approx(a * b * c, rel=1e-12)
    assert found.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(found.centre, (0.3, -0.2, 0.05), atol=1e-14)
    np.testing.assert_allclose(found.inertia, mass / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b]), atol=1e-15)


def test_sphere_and_cylinder_within_their_facets():
    found = mass_properties(mesh_of(trimesh.creation.icosphere(5, 0.05)), 1000.0)
    mass = 1000.0 * 4 / 3 * np.pi * 0.05**3
    assert found.mass == pytest.approx(mass, rel=2e-3)
    np.testing.assert_allclose(found.inertia, 0.4 * mass * 0.05**2 * np.eye(3), atol=3e-3 * 0.4 * mass * 0.05**2)
    found = mass_properties(mesh_of(trimesh.creation.cylinder(0.03, 0.1, sections=256)), 1000.0)
    mass = 1000.0 * np.pi * 0.03**2 * 0.1
    assert found.inertia[2, 2] == pytest.approx(0.5 * mass * 0.03**2, rel=1e-3)
    assert found.inertia[0, 0] == pytest.approx(mass * (3 * 0.03**2 + 0.1**2) / 12, rel=1e-3)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    density=st.floats(10, 8000),
    offset=st.tuples(*[st.floats(-1, 1)] * 3),
)
def test_any_closed_mesh_agrees_with_trimesh(seed, density, offset):
    rng = np.random.default_rng(seed)
    shape = trimesh.creation.icosphere(2, 0.05)
    # A bumpy, stretched star-shaped body is closed and concave.
    shape.vertices *= (1 + 0.3 * rng.uniform(-1, 1, (len(shape.vertices), 1))) * rng.uniform(0.5, 1.5, 3)
    mesh = mesh_of(shape, offset)
    reference = mesh.trimesh()
    reference.density = density
    found = mass_properties(mesh, density)
    assert found.mass == pytest.approx(reference.mass, rel=1e-9)
    np.testing.assert_allclose(found.centre, reference.center_mass, atol=1e-10)
    # trimesh integrates from the world's origin and loses digits far from it.
    np.testing.assert_allclose(found.inertia, reference.moment_inertia, atol=1e-6 * np.abs(found.inertia).max())


def test_open_and_inverted_meshes_are_refused():
    box = mesh_of(trimesh.creation.box((1, 1, 1)))
    with pytest.raises(ValueError, match="watertight"):
        mass_properties(Mesh(box.vertices, box.faces[1:]), 1.0)
    with pytest.raises(ValueError, match="inside out"):
        mass_properties(Mesh(box.vertices, box.faces[:, ::-1]), 1.0)


def test_body_frame_is_the_footprints_centre():
    pose = body_from_table(mesh_of(trimesh.creation.box((0.04, 0.06, 0.1)), (0.3, -0.2, 0.05)))
    np.testing.assert_allclose(pose, [[1, 0, 0, -0.3], [0, 1, 0, 0.2], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.3, 1.2])
def test_narrowest_width_is_found_at_any_yaw(yaw):
    vertices = mesh_of(trimesh.creation.box((0.04, 0.06, 0.1))).vertices
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    assert narrowest_width(vertices @ turn.T) == pytest.approx(0.04)


def test_densities():
    for said in ("wood", 432.1, 100, 5, 25_000, *DENSITIES):
        assert AssetSettings(density=said).density == said
    for bad in (0.0, -5.0, 0.6, 4.99, 25_001, 1e6, float("nan"), True, "unobtainium"):
        with pytest.raises(InputError, match=r"density: .*(kg/m3|wood)"):
            AssetSettings(density=bad)
