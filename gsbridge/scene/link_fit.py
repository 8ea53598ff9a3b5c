"""Fitting splats on a known mesh to its silhouette: opaque inside, nothing outside.

Discs spread over a surface stand out beyond its edges by about their own radius, which on a gripper's finger is as much as the
finger is thick. Some seconds of training against renderings of the mesh itself move and shrink them; no photo is involved.
"""

from __future__ import annotations

import numpy as np
import torch

from gsbridge.cameras import Camera, look_at
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.scene.meshes import MeshComposition, uniform
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.rasterize import rasterize

STEPS = 250
"""Optimisation steps; each looks at one random view."""

HOLES = 3.0
"""Weight in the loss of light missing inside the silhouette; light outside it has weight 1. A hole weighs more because what
shines through it has another colour. Within a pixel of the outline, missing light is an edge drawn too far in: weight 1."""

_IMAGE = 128
_FILL = 0.9  # share of the image's width that the mesh's bounding ball fills
_NEAR, _FAR = 2.5, 5.0  # distances, in radii of that ball
_RATES = {"shift": 0.02, "stretch": 0.02, "turn": 0.01, "opacity": 0.05}
_LAST_RATE = 0.01  # last learning rate, as a share of the first
_THINNEST = 1e-4  # m: a disc of no thickness gets no gradient across


def fit_to_mesh(cloud: Cloud, mesh: Mesh, *, steps: int = STEPS, seed: int = 0) -> Cloud:
    """Move, turn, stretch and fade splats until their silhouette is the mesh's, from all sides.

    Args:
        cloud: Splats on the mesh, as from `splats_on_mesh`; colours stay.
        mesh: The link's surface, in the same frame.
        steps: Gradient steps.
        seed: Seed of the views; equal seeds give equal splats on one thread.

    Returns:
        As many splats, same order.
    """
    rng = np.random.default_rng(seed)
    middle = 0.5 * (mesh.vertices.min(0) + mesh.vertices.max(0))
    radius = float(np.linalg.norm(mesh.vertices - middle, axis=1).max())
    target = MeshComposition({"mesh": uniform(mesh, (1.0, 1.0, 1.0))})
    width = float(np.sqrt(mesh.areas().sum() / len(cloud)))
    means, quats, colours = (torch.from_numpy(x) for x in (cloud.means, cloud.quats, cloud.colours))
    change = {
        "shift": torch.zeros(len(cloud), 3),
        "stretch": torch.log(torch.from_numpy(cloud.scales).clamp_min(_THINNEST)),
        "turn": torch.zeros(len(cloud), 4),
        "opacity": torch.logit(torch.from_numpy(cloud.opacities).clamp(0.01, 0.95)),
    }
    for value in change.values():
        value.requires_grad_()
    groups = [{"params": [change[name]], "lr": rate} for name, rate in _RATES.items()]
    optimizer = torch.optim.Adam(groups, betas=(0.9, 0.99))
    schedule = torch.optim.lr_scheduler.ExponentialLR(optimizer, _LAST_RATE ** (1.0 / max(steps, 1)))

    def shape() -> tuple[torch.Tensor, ...]:
        shifted = means + width * change["shift"]
        return shifted, quats + change["turn"], torch.exp(change["stretch"]), torch.sigmoid(change["opacity"]), colours

    for _ in range(steps):
        camera, pose = _random_view(middle, radius, rng)
        wanted = torch.from_numpy(target.coverage(camera, pose, samples=3).astype(np.float32))
        missing = wanted - rasterize(*shape(), camera=camera, cam_from_table=pose).alphas
        # A pixel is inside only if its eight neighbours are covered, too, which leaves out the outline's own pixels.
        inside = -torch.nn.functional.max_pool2d(-wanted[None, None], 3, stride=1, padding=1)[0, 0] > 0.99
        loss = (torch.where(inside, HOLES, 1.0) * torch.relu(missing) + torch.relu(-missing)).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    with torch.no_grad():
        found = shape()
    return Cloud(found[0].numpy(), torch.nn.functional.normalize(found[1], dim=1).numpy(), *(x.numpy() for x in found[2:]))


def _random_view(middle: Array, radius: float, rng: np.random.Generator) -> tuple[Camera, Array]:
    """A camera in a random place round a ball; the ball fills most of the image."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    distance = radius * rng.uniform(_NEAR, _FAR)
    focal = 0.5 * _FILL * _IMAGE * np.sqrt(distance**2 - radius**2) / radius
    up = np.eye(3)[np.argmin(np.abs(direction))]
    return Camera(_IMAGE, _IMAGE, focal, focal, _IMAGE / 2, _IMAGE / 2), look_at(middle + distance * direction, middle, up)
