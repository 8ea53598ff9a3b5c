"""Models of thrown bodies, and their meshes, that are well formed but make no sense."""

import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from gsbridge.errors import InputError
from gsbridge.gap.contact.body import read_body
from gsbridge.meshes import Mesh, read_mesh, write_mesh
from tests.fuzz.samples import Reader
from tests.fuzz.test_readers import read_within

BOX = {"box": [0.1, 0.1, 0.1], "mass": 0.4, "controller": {"mode": "body"}, "contact": {"friction": 0.4}}
ODD = {
    "no number for the centre of mass": {"centre_of_mass": [float("nan"), 0.0, 0.0]},
    "an endless centre of mass": {"centre_of_mass": [0.0, float("inf"), 0.0]},
    "a centre of mass kilometres away": {"centre_of_mass": [0.0, 4e3, 0.0]},
    "words for the centre of mass": {"centre_of_mass": ["a", 0.0, 0.0]},
    "truth values for the centre of mass": {"centre_of_mass": [True, 0.0, 0.0]},
    "one number for the centre of mass": {"centre_of_mass": 0.1},
    "an upright surface": {"surface": {"tilt": [1.6, 0.0]}},
    "a tilt that is no number": {"surface": {"tilt": [float("nan"), 0.0]}},
    "a height that is a truth value": {"surface": {"height": True}},
    "a height that is a text": {"surface": {"height": "060"}},
    "a height that is nothing": {"surface": {"height": None}},
    "a mass that is nothing": {"mass": None},
    "an endless mass": {"mass": float("inf")},
    "a mass beyond measure": {"mass": 1e300},
    "an inertia that is no number": {"inertia": [float("nan"), 1e-4, 1e-4]},
    "an inertia of a stick's half": {"inertia": [1e-4, 1e-4, 1.0]},
    "a negative friction": {"contact": {"friction": -0.1}},
    "a friction that is a truth value": {"contact": {"friction": True}},
    "a surface that is no section": {"surface": 0},
    "effects that are no list": {"effects": False},
    "an endless friction": {"contact": {"friction": float("inf")}},
    "more steps than can be made": {"physics_rate": 1e12},
    "no length of an edge": {"box": [0.1, 0.1, 0.0]},
    "edges in millimetres": {"box": [100.0, 100.0, 100.0]},
    "an edge that is no number": {"box": [0.1, 0.1, float("nan")]},
}


@pytest.mark.parametrize("what", ODD)
def test_models_that_mean_nothing_are_refused(what, tmp_path):
    path = tmp_path / "body.yaml"
    path.write_text(yaml.safe_dump(BOX))
    read_body(path)
    path.write_text(yaml.safe_dump({**BOX, **ODD[what]}))
    with pytest.raises(InputError):
        read_body(path)


def test_a_number_without_a_point_before_its_exponent_is_one(tmp_path):
    (tmp_path / "body.yaml").write_text(yaml.safe_dump(BOX).replace("friction: 0.4", "friction: 4e-1"))
    assert read_body(tmp_path / "body.yaml").figures["friction"] == 0.4


SHAPES = {
    "no shape": "",
    "an unknown shape": "<torus radius='1'/>",
    "a box without a size": "<box/>",
    "a box of negative size": "<box size='0.1 -0.1 0.1'/>",
    "a box of words": "<box size='a b c'/>",
    "a box of two edges": "<box size='0.1 0.1'/>",
    "a ball of no radius": "<sphere radius='0'/>",
    "a ball whose radius is no number": "<sphere radius='nan'/>",
    "a ball in millimetres": "<sphere radius='35'/>",
    "a cylinder without a length": "<cylinder radius='0.1'/>",
    "a mesh that is not there": "<mesh filename='none.obj'/>",
    "a mesh without a name": "<mesh/>",
    "a mesh that is a folder": "<mesh filename='.'/>",
    "a mesh with a name that no system takes": f"<mesh filename='{'x' * 5000}.obj'/>",
    "a mesh of scale zero": "<mesh filename='cube.ply' scale='0 1 1'/>",
    "a mesh whose scale is no number": "<mesh filename='cube.ply' scale='nan 1 1'/>",
    "a mesh in millimetres": "<mesh filename='cube.ply' scale='1000 1000 1000'/>",
    "a mesh of one point": "<mesh filename='point.obj'/>",
    "a pipe": "<mesh filename='pipe.obj'/>",
}
SOUND = {
    "a mesh": "<mesh filename='cube.ply'/>",
    "a mesh by its address": "<mesh filename='file://{folder}/cube.ply'/>",
    "a mesh in millimetres with its scale": "<mesh filename='large.ply' scale='0.001 0.001 0.001'/>",
    "a mesh with one scale": "<mesh filename='large.ply' scale='0.001'/>",
    "a mirrored mesh": "<mesh filename='cube.ply' scale='1 -1 1'/>",
    "a ball": "<sphere radius='0.035'/>",
}


def write_body(folder: Path, shape: str, origin: str = "") -> Path:
    """A model whose URDF has this shape, there."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    write_mesh(folder / "cube.ply", Mesh(corners, faces))
    write_mesh(folder / "large.ply", Mesh(1000 * corners, faces))
    (folder / "point.obj").write_text("v 0 0 0\n")
    os.mkfifo(folder / "pipe.obj")
    (folder / "body.urdf").write_text(
        '<robot name="body"><link name="body"><inertial><mass value="0.4"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0"'
        f' ixz="0" iyz="0"/></inertial><collision>{origin}<geometry>{shape.format(folder=folder)}</geometry></collision></link>'
        "</robot>"
    )
    model = {key: value for key, value in BOX.items() if key not in ("box", "mass")}
    (folder / "body.yaml").write_text(yaml.safe_dump({"urdf": "body.urdf", **model}))
    return folder / "body.yaml"


@pytest.mark.parametrize("what", SHAPES)
def test_shapes_that_mean_nothing_are_refused(what, tmp_path):
    path = write_body(tmp_path, SHAPES[what])

    def read(path: Path) -> None:
        with pytest.raises(InputError):
            read_body(path)

    read_within(Reader(lambda folder: folder, read), path)


@pytest.mark.parametrize("place", ["a 0 0", "nan 0 0", "0 0", "0 0 5000"])
def test_shapes_that_lie_nowhere_are_refused(place, tmp_path):
    path = write_body(tmp_path, SOUND["a ball"], f"<origin xyz='{place}'/>")
    with pytest.raises(InputError, match="damaged origin"):
        read_body(path)


@pytest.mark.parametrize("what", SOUND)
def test_sound_shapes_are_read(what, tmp_path):
    assert len(read_body(write_body(tmp_path, SOUND[what])).shapes) == 1


MESHES = {
    "a vertex that is not there.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
    "a vertex that is not there.ply": (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"
    ),
    "a vertex that is no number.obj": "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "nothing.obj": "",
    "nothing.stl": "",
}


@pytest.mark.parametrize("name", MESHES)
def test_broken_meshes_are_refused(name, tmp_path):
    (tmp_path / name).write_text(MESHES[name])
    with pytest.raises(InputError, match="Delete it"):
        read_mesh(tmp_path / name)


def test_a_pipe_is_no_mesh(tmp_path):
    os.mkfifo(tmp_path / "pipe.ply")
    with pytest.raises(InputError, match="pipe"):
        read_mesh(tmp_path / "pipe.ply")
