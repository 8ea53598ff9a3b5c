"""Which mesh defines a body, on boxes whose volumes and places are known."""

import re

import numpy as np
import pytest
import trimesh

from gsbridge.asset.solid import choose_solid
from gsbridge.errors import InputError
from gsbridge.meshes import Mesh

SIZE = np.array([0.06, 0.05, 0.04])


def box(size=SIZE, centre=(0.1, -0.2, 0.02)) -> Mesh:
    made = trimesh.creation.box(size)
    return Mesh(np.asarray(made.vertices) + centre, np.asarray(made.faces, np.int64))


def turned(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1])


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def chosen(visual: Mesh, collision: Mesh | None = None):
    return choose_solid(visual, box() if collision is None else collision, "visual.ply", "collision.ply")


def test_a_closed_surface_inside_the_hull_is_taken_without_a_word():
    found = chosen(box())
    assert (found.which, found.reasons) == ("visual", [])
    assert found.mesh.volume() == pytest.approx(SIZE.prod())


def test_a_closed_cavity_is_no_second_piece():
    found = chosen(joined(box(), turned(box(SIZE / 2))))
    assert (found.which, found.reasons) == ("visual", [])
    assert found.mesh.volume() == pytest.approx(SIZE.prod() * 7 / 8)


@pytest.mark.parametrize(
    ("visual", "reasons"),
    [
        # The same surface twice, as a careless merge leaves it.
        (joined(box(), box()), ["2 separate pieces", "encloses 240 cm3, the outlines' hull 120 cm3"]),
        (joined(box(), box(SIZE / 2)), ["2 separate pieces"]),
        (joined(box(SIZE / 2), box(SIZE / 8, (0.1, -0.2, 0.037))), ["2 separate pieces"]),
        (box([0.06, 0.05, 0.05]), ["stands out 5 mm beyond", "encloses 150 cm3"]),
        (box(centre=(0.107, -0.2, 0.02)), ["stands out 7 mm beyond", "ends 7 mm inside"]),
        (box([0.06, 0.05, 0.03], (0.1, -0.2, 0.015)), ["ends 10 mm inside"]),
    ],
)
def test_what_the_outlines_contradict_is_told(visual, reasons):
    found = chosen(visual)
    assert found.which == "visual"
    assert [text for text in reasons if not any(text in reason for reason in found.reasons)] == []


@pytest.mark.parametrize(
    ("visual", "fault"),
    [
        (Mesh(box().vertices, box().faces[:-1]), "is not watertight"),
        (turned(box()), "is inside out"),
        (joined(box(SIZE / 4), turned(box(SIZE / 4, (0.12, -0.2, 0.02)))), "has a piece that is inside out"),
    ],
)
def test_a_surface_without_a_solid_falls_back_to_the_hull_with_its_fault(visual, fault):
    found = chosen(visual)
    assert found.which == "collision"
    assert found.reasons[-1] == f"the visual mesh {fault}; the body is the hull of the outlines"
    with pytest.raises(InputError, match=f"the mesh {fault}, and collision.ply encloses no volume"):
        chosen(visual, Mesh(box().vertices, box().faces[:-1]))


def test_meshes_beside_each_other_are_refused():
    with pytest.raises(InputError, match=r"lies 940 mm beside the outlines' hull collision\.ply"):
        chosen(box(centre=(1.1, -0.2, 0.02)), box())


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_hull_that_stands_out_on_any_side_is_logged(caplog, axis, side):
    """A hull that is stretched by 5 mm on one side; the surface keeps its own sides."""
    surface = box()
    stretched = surface.vertices.copy()
    stretched[side * (surface.vertices - surface.vertices.mean(0))[:, axis] > 0, axis] += side * 0.005
    caplog.set_level("INFO", "gsbridge")
    found = chosen(surface, Mesh(stretched, surface.faces))
    assert (found.which, found.reasons) == ("visual", [])
    told = re.findall(r"\[([^]]*)\] mm", caplog.text)
    excess = np.array([[float(value) for value in text.split()] for text in told])
    expected = np.zeros((2, 3))
    expected[(side + 1) // 2, axis] = 5.0
    np.testing.assert_allclose(excess, expected, atol=0.05)
