"""GaMeS with vertices free to move: a training smooths a poor mesh, and gains by it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from ball_scene import RADIUS, targets

from gsbridge.configuration.splats import SplatSettings
from gsbridge.meshes import Mesh
from gsbridge.splats import train as trainer
from gsbridge.splats.binding import Binding, create_binding
from gsbridge.splats.evaluate import evaluate_cloud


def test_free_vertices_mend_a_poor_mesh(tmp_path: Path) -> None:
    """A ball with bumps of a few millimetres, photos of the true one."""
    ball = trimesh.creation.icosphere(3, RADIUS)
    true = np.asarray(ball.vertices)
    bumps = 1 + 0.05 * np.sin(40 * true[:, :1]) * np.sin(40 * true[:, 1:2])
    mesh, photos = Mesh(true * bumps, np.asarray(ball.faces)), targets(sheen=0.0)

    def run(kind: str) -> tuple[Binding, float]:
        binding = create_binding(kind, mesh, 1, band=0.01, seed=0)
        trainer.train(binding, photos, SplatSettings(steps=400), kind="object", seed=0, state=tmp_path / kind)
        return binding, float(evaluate_cloud(binding.evaluate(), photos, kind="object")["held_out"]["masked"]["psnr"])

    frozen, before = run("games")
    moved, after = run("games_vertices")
    np.testing.assert_array_equal(frozen.vertices, mesh.vertices)
    assert after > before + 3
    # Training removes the bumps. It also moves the whole surface inwards, since blurred discs would otherwise stand out.
    radii = [np.linalg.norm(vertices, axis=1) for vertices in (frozen.vertices, moved.vertices)]
    assert radii[1].std() < 0.5 * radii[0].std()
    assert 0.9 * RADIUS < radii[1].mean() < RADIUS
    assert np.linalg.norm(moved.vertices - mesh.vertices, axis=1).max() < 0.01
