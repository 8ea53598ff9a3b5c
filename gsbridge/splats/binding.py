"""Binding of splats to a mesh: hard (GaMeS), hard with trained vertices, soft (the paper's equation 2), refined, or none.

A bound splat belongs to one face with corners v1, v2, v3 and unit normal n. Its centre is

    w1 v1 + w2 v2 + w3 v3 + band * tanh(b) * n,    w = relu(a) / sum(relu(a)),

with learned `a` and `b`. The paper bounds the offset by one unit of the reconstruction. Here the band is metric (10 mm by
default), because that unit is arbitrary: with the released scales it is about 100 mm. `games` keeps b = 0. `games_vertices`
does so, too, but its training also moves the mesh's vertices; the result is a `games` binding to the moved mesh.

The axes of a splat are (n, e1, e2): e1 points from the face's centroid to its second corner, and e2 is perpendicular to e1 in
the face. The standard deviations are (0, |e1| / 2, |(v3 - centroid) . e2| / 2) times one learned factor; e2 has unit length.
`refined` turns each splat freely in its face's frame and scales its axes separately. All kinds but `unbound` can be evaluated
on a deformed mesh. Harmonics are stored in the frame of the rest mesh and turn with their face.

Source: Wu et al., RL-GSBridge, 2024, equations 1 and 2; Waczynska et al., GaMeS, 2024.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from gsbridge.configuration.bindings import BINDINGS
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array, quat_from_rotation, rotation_from_quat
from gsbridge.meshes import Mesh
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.harmonics import TERMS, turned

START_OPACITY = 0.5
"""Opacity at the start. The paper starts at 0.1, but trains 15 times as long."""

FLATNESS = 1e-6
"""Standard deviation along the normal, m: the paper's discs are flat."""

REFINED_FLATNESS = 0.1
"""Standard deviation along the normal at the start of `refined` and `unbound`, as a share of the smaller one in the face."""


class SplatShape(NamedTuple):
    """Geometry of all splats: means [N, 3] m, quats [N, 4] wxyz, scales [N, 3] m."""

    means: Tensor
    quats: Tensor
    scales: Tensor


class Frames(NamedTuple):
    """Face frames: corners [F, 3, 3], normals [F, 3], quats of the axes (n, e1, e2) [F, 4], standard deviations [F, 2], m."""

    corners: Tensor
    normals: Tensor
    quats: Tensor
    spreads: Tensor


def face_frames(vertices: Array, faces: Array) -> Frames:
    """Return the frames of all faces, float32; degenerate faces get a spread of zero. [V, 3], [F, 3]."""
    corners = np.asarray(vertices, dtype=np.float64)[faces]
    first, second, third = np.moveaxis(corners, 1, 0)
    cross = np.cross(second - first, third - first)
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    # A face without area has no normal; any direction will do, because its splats have no size.
    normals = np.where(length > 0, cross / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])
    centroid = corners.mean(1)
    along = second - centroid
    reach = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.where(reach > 0, along / np.maximum(reach, 1e-300), [1.0, 0.0, 0.0])
    across = np.cross(normals, along)
    spreads = np.stack([reach[:, 0], np.abs(((third - centroid) * across).sum(1))], axis=1) / 2
    quats = quat_from_rotation(np.stack([normals, along, across], axis=-1))
    return Frames(*(torch.as_tensor(x.astype(np.float32)) for x in (corners, normals, quats, spreads)))


def moving_frames(vertices: Tensor, faces: Tensor) -> Frames:
    """Return `face_frames` of vertices in training: differentiable, in the precision of the vertices. [V, 3], [F, 3]."""
    corners = vertices[faces]
    first, second, third = corners.unbind(1)
    normals = torch.nn.functional.normalize(torch.linalg.cross(second - first, third - first), dim=1, eps=1e-20)
    along = second - corners.mean(1)
    reach = along.norm(dim=1)
    along = torch.nn.functional.normalize(along, dim=1, eps=1e-20)
    across = torch.linalg.cross(normals, along)
    spreads = torch.stack([reach, ((third - corners.mean(1)) * across).sum(1).abs()], dim=1) / 2
    return Frames(corners, normals, _quats(torch.stack([normals, along, across], dim=-1)), spreads)


def _quats(rotations: Tensor) -> Tensor:
    """Return quaternions wxyz of rotation matrices, differentiable. [N, 3, 3] -> [N, 4].

    Source: Shepperd, J. Guidance 1(3), 1978: any component of the quaternion can be the divisor, and the largest one is safe.
    """
    (a, b, c), (d, e, f), (g, h, i) = (row.unbind(1) for row in rotations.unbind(1))
    rows = [
        [1 + a + e + i, h - f, c - g, d - b],
        [h - f, 1 + a - e - i, b + d, c + g],
        [c - g, b + d, 1 - a + e - i, f + h],
        [d - b, c + g, f + h, 1 - a - e + i],
    ]
    # Row k is the quaternion times four times its component k.
    table = torch.stack([torch.stack(row, 1) for row in rows], 1)
    largest = table.diagonal(dim1=1, dim2=2).argmax(1)
    return torch.nn.functional.normalize(table[torch.arange(len(table)), largest], dim=1, eps=1e-20)


@dataclass
class Binding:
    """Splats and their binding to a mesh. Training changes the parameters.

    Args:
        kind: `games`, `games_vertices`, `soft`, `refined` or `unbound`.
        vertices: Vertices of the rest mesh, table frame, m. [V, 3] float64.
        faces: Vertex indices of the faces. [F, 3] int64.
        face_index: Face of each splat. [N] int64.
        band: Largest offset along the normal, m.
        parameters: Raw values. All kinds have `colour` [N, 3] and `opacity` [N] (a logit). Bound kinds have `weights` [N, 3];
            `soft` and `refined` have `offset` [N]; all bound kinds but `refined` have `multiplier` [N]; `refined` has `turn`
            [N, 4] and `stretch` [N, 3] (logarithms). `unbound` has `means`, `quats` and `stretch` (logarithms of the scales).
            With a degree above 0 there are `harmonics` [N, K, 3]. While vertices are trained, `vertices` [V, 3], m, replaces
            the field `vertices`.
    """

    kind: str
    vertices: Array
    faces: Array
    face_index: Array
    band: float
    parameters: dict[str, Tensor]

    def __len__(self) -> int:
        return len(self.face_index)

    def frames(self, vertices: Array | None = None) -> Frames:
        """Return the frame of each splat's face, one row per splat, on the rest mesh or on other `vertices` [V, 3], m."""
        if vertices is None and "vertices" in self.parameters:
            frames = moving_frames(self.parameters["vertices"], torch.as_tensor(self.faces))
        else:
            frames = face_frames(self.vertices if vertices is None else vertices, self.faces)
        index = torch.as_tensor(self.face_index)
        return Frames(*(item[index] for item in frames))

    def settle(self) -> None:
        """Make the trained vertices those of the rest mesh; do nothing if the vertices were not trained."""
        if "vertices" in self.parameters:
            self.vertices = self.parameters.pop("vertices").detach().numpy().astype(np.float64)

    def offsets(self) -> Tensor:
        """Return the offset along the normal, m; zero for kinds without an offset. [N]."""
        if "offset" not in self.parameters:
            return torch.zeros(len(self))
        return self.band * torch.tanh(self.parameters["offset"])

    def shape(self, frames: Frames) -> SplatShape:
        """Return the geometry of the splats in given face frames; differentiable with respect to the parameters."""
        p = self.parameters
        if self.kind == "unbound":
            return SplatShape(p["means"], p["quats"], torch.exp(p["stretch"]))
        weights = torch.relu(p["weights"]) + 1e-8
        weights = weights / weights.sum(1, keepdim=True)
        means = torch.bmm(weights[:, None, :], frames.corners)[:, 0]
        if "offset" in p:
            means = means + self.offsets()[:, None] * frames.normals
        if self.kind == "refined":
            turn = torch.nn.functional.normalize(p["turn"], dim=1)
            spreads = torch.cat([frames.spreads.amin(1, keepdim=True) * REFINED_FLATNESS, frames.spreads], dim=1)
            return SplatShape(means, _multiply(frames.quats, turn), spreads * torch.exp(p["stretch"]))
        factor = torch.relu(p["multiplier"])[:, None]
        flat = torch.full_like(factor, FLATNESS)
        return SplatShape(means, frames.quats, torch.cat([flat, frames.spreads * factor + 1e-8], dim=1))

    def evaluate(self, vertices: Array | None = None) -> Cloud:
        """Return the splats on the rest mesh or a deformed one: centres, orientations, sizes and harmonics follow the faces.

        Args:
            vertices: Deformed positions of the binding's own vertices, m; normals are computed again. [V, 3].

        Raises:
            ValueError: The splats are unbound, or the number of vertices differs.
        """
        if vertices is not None and self.kind == "unbound":
            raise ValueError("unbound splats do not follow a mesh")
        if vertices is not None and np.shape(vertices) != self.vertices.shape:
            raise ValueError(f"the deformed mesh must have {len(self.vertices)} vertices, not {len(vertices)}")
        with torch.no_grad():
            frames = self.frames(vertices)
            shape = self.shape(frames)
            quats = torch.nn.functional.normalize(shape.quats, dim=1)
            return Cloud(
                shape.means.numpy(),
                quats.numpy(),
                shape.scales.numpy(),
                torch.sigmoid(self.parameters["opacity"]).numpy(),
                self.parameters["colour"].clamp(0, 1).numpy(),
                self._harmonics(None if vertices is None else frames),
            )

    def _harmonics(self, deformed: Frames | None) -> Array:
        """Return the harmonics on the rest mesh, or turned with the faces of a deformed mesh. [N, K, 3]."""
        if "harmonics" not in self.parameters:
            return np.zeros((len(self), 0, 3), np.float32)
        harmonics = self.parameters["harmonics"].numpy()
        if deformed is None:
            return harmonics
        before, after = (rotation_from_quat(frames.quats.numpy().astype(np.float64)) for frames in (self.frames(), deformed))
        return turned(harmonics, after @ before.swapaxes(1, 2))


def create_binding(kind: str, mesh: Mesh, splats_per_face: int, *, band: float, seed: int, sh_degree: int = 0) -> Binding:
    """Create splats at the start of training: with the same positions, sizes, opacities and colours for every kind.

    Args:
        kind: `games`, `games_vertices`, `soft`, `refined` or `unbound`.
        mesh: Evenly meshed surface, table frame, m.
        splats_per_face: Number of splats on each face.
        band: Largest offset along the normal, m.
        seed: Seed of the positions inside the faces.
        sh_degree: Degree of the spherical harmonics, 0 to 3; they start at zero.

    Raises:
        ValueError: The kind is unknown, or the band is not positive.
    """
    if kind not in BINDINGS or not band > 0:
        raise ValueError(f"a binding is one of {', '.join(BINDINGS)}, with a positive band; got {kind!r}, {band}")
    face_index = np.repeat(np.arange(len(mesh.faces)), splats_per_face)
    count = len(face_index)
    rng = np.random.default_rng(seed)
    parameters = {
        "weights": torch.as_tensor(rng.random((count, 3), dtype=np.float32)),
        "offset": torch.zeros(count),
        "multiplier": torch.ones(count),
        "opacity": torch.full((count,), float(np.log(START_OPACITY / (1 - START_OPACITY)))),
        "colour": torch.full((count, 3), 0.5),
    }
    start = Binding("soft", mesh.vertices, mesh.faces, face_index, band, parameters)
    if kind in ("games", "games_vertices"):
        del parameters["offset"]
    elif kind == "refined":
        del parameters["multiplier"]
        parameters["turn"] = torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1)
        parameters["stretch"] = torch.zeros(count, 3)
    elif kind == "unbound":
        shape = start.shape(start.frames())
        scales = shape.scales.clone()
        scales[:, 0] = scales[:, 1:].amin(1) * REFINED_FLATNESS
        for name in ("weights", "offset", "multiplier"):
            del parameters[name]
        parameters |= {"means": shape.means, "quats": shape.quats, "stretch": torch.log(scales.clamp_min(1e-8))}
    if kind == "games_vertices":
        parameters["vertices"] = torch.as_tensor(mesh.vertices.astype(np.float32))
    if sh_degree > 0:
        parameters["harmonics"] = torch.zeros(count, TERMS[sh_degree], 3)
    return Binding(kind, mesh.vertices, mesh.faces, face_index, band, parameters)


def _multiply(left: Tensor, right: Tensor) -> Tensor:
    """Return the Hamilton product of quaternions (wxyz), differentiable. [N, 4]."""
    lw, lx, ly, lz = left.unbind(1)
    rw, rx, ry, rz = right.unbind(1)
    return torch.stack(
        [
            lw * rw - lx * rx - ly * ry - lz * rz,
            lw * rx + lx * rw + ly * rz - lz * ry,
            lw * ry - lx * rz + ly * rw + lz * rx,
            lw * rz + lx * ry - ly * rx + lz * rw,
        ],
        dim=1,
    )


def write_binding(path: str | Path, binding: Binding) -> None:
    """Write a binding with its rest mesh, whole or not at all."""
    with atomic_file(path) as temporary, temporary.open("wb") as stream:
        parameters: dict[str, Any] = {f"parameter_{name}": value.detach().numpy() for name, value in binding.parameters.items()}
        np.savez_compressed(
            stream,
            kind=np.array(binding.kind),
            vertices=binding.vertices,
            faces=binding.faces.astype(np.int32),
            face_index=binding.face_index.astype(np.int32),
            band=np.array(binding.band),
            **parameters,
        )


def read_binding(path: str | Path) -> Binding:
    """Read a binding.

    Raises:
        InputError: The file is missing or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            items = {name: content[name] for name in content.files}
        binding = Binding(
            str(items["kind"]),
            items["vertices"],
            items["faces"].astype(np.int64),
            items["face_index"].astype(np.int64),
            float(items["band"]),
            {name.removeprefix("parameter_"): torch.as_tensor(items[name]) for name in items if name.startswith("parameter_")},
        )
        binding.evaluate()
    except FileNotFoundError as error:
        raise InputError(path, "the binding does not exist", "Check the path, or run the splats stage") from error
    except Exception as error:  # numpy and zipfile raise many kinds for damaged files; the user needs one clear line
        raise InputError(path, f"the binding cannot be read ({error})", "Delete it and run the splats stage again") from error
    return binding
