"""Splats on a ball whose shading is known: `python -m benchmarks.ball` writes the tables of docs/splats.md, in a minute or so.

Every figure is the masked PSNR of held-out photos, dB, after 400 steps. Photos and ball are those of the unit tests
(`tests/unit/ball_scene.py`), which only check in what order some of these figures stand.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

from gsbridge.configuration.splats import SplatSettings
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.splats import train as trainer
from gsbridge.splats.binding import create_binding
from gsbridge.splats.evaluate import evaluate_cloud

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs/splats.md"
sys.path.insert(0, str(ROOT / "tests/unit"))

from ball_scene import RADIUS, VIEWS, held_out, targets  # noqa: E402  (beside the tests)

STEPS = 400
KINDS = ("games", "soft", "refined", "games_vertices")
SHEENS = {
    "matt": {"sheen": 0.0},
    "broad sheen (exponent 6)": {"sheen": 0.35, "sharpness": 6.0},
    "narrower sheen (exponent 20)": {"sheen": 0.35, "sharpness": 20.0},
}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown.

    Args:
        head: Titles of the columns.
        rows: Cells of each row.
    """
    first, *others = (f"| {' | '.join(cells)} |" for cells in (head, *rows))
    return "\n".join([first, f"|{'---|' * len(head)}", *others])


def on_mesh(mesh: Mesh, kind: str) -> float:
    """Masked PSNR of held-out photos of the matt ball, dB, with splats bound to a mesh of it.

    Args:
        mesh: The mesh, m.
        kind: Binding, see `gsbridge.splats.binding.BINDINGS`.
    """
    photos, binding = targets(sheen=0.0), create_binding(kind, mesh, 1, band=0.01, seed=0)
    with tempfile.TemporaryDirectory() as folder:
        trainer.train(binding, photos, SplatSettings(steps=STEPS), kind="object", seed=0, state=Path(folder) / kind)
    return float(evaluate_cloud(binding.evaluate(), photos, kind="object")["held_out"]["masked"]["psnr"])


def bindings() -> str:
    """Table of the bindings on the exact ball and on one with bumps."""
    ball = trimesh.creation.icosphere(3, RADIUS)
    true, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    bumpy = true * (1 + 0.05 * np.sin(40 * true[:, :1]) * np.sin(40 * true[:, 1:2]))
    deviation = 1e3 * float(np.linalg.norm(bumpy, axis=1).std())
    meshes = {"exact": Mesh(true, faces), f"bumps of {deviation:.1f} mm standard deviation": Mesh(bumpy, faces)}
    rows = [[name, *(f"{on_mesh(mesh, kind):.1f}" for kind in KINDS)] for name, mesh in meshes.items()]
    return table(["mesh", *(f"`{kind}`" for kind in KINDS)], rows)


def psnr(photos: list, **options: object) -> str:
    """Masked PSNR of held-out photos after one training, dB, as text.

    Args:
        photos: Photos of the ball, of both splits.
        **options: See `ball_scene.held_out`.
    """
    with tempfile.TemporaryDirectory() as folder:
        return f"{held_out(photos, Path(folder), steps=STEPS, **options)[0]:.1f}"


def sheens() -> str:
    """Table of degrees of the spherical harmonics on balls of different sheen."""
    photos = [targets(**sheen) for sheen in SHEENS.values()]
    rows = [[str(degree), *(psnr(of, degree=degree) for of in photos)] for degree in range(4)]
    return table(["degree", *SHEENS], rows)


def drawn_gains() -> Array:
    """Gains on linear light, per photo and channel, of a camera that changes exposure and white balance. [VIEWS, 3]."""
    rng = np.random.default_rng(0)
    return 0.8 * np.exp(rng.normal(0, 0.25, (VIEWS, 1)) + rng.normal(0, 0.06, (VIEWS, 3)))


def exposures() -> str:
    """Table of a film with locked exposure and one without, trained without and with an exposure fitted per photo."""
    films = {"locked": np.full((VIEWS, 3), 0.8), "re-exposing": drawn_gains()}
    photos = {name: targets(0.0, gains=gains) for name, gains in films.items()}
    rows = [[name, *(psnr(of, per_photo=fit) for fit in (False, True))] for name, of in photos.items()]
    return table(["film", "`locked`", "`per_photo`"], rows)


def main() -> None:
    """Write the tables between their marks on the page."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    text = PAGE.read_text(encoding="utf-8")
    for name, block in (("bindings", bindings), ("sheen", sheens), ("exposure", exposures)):
        mark = f"<!-- ball: {name}, by `python -m benchmarks.ball` -->"
        text, found = re.subn(
            rf"({re.escape(mark)}\n\n).*?(\n\n<!-- end of ball -->)", rf"\g<1>{block()}\g<2>", text, flags=re.S
        )
        if found != 1:
            raise ValueError(f"{PAGE}: the mark {mark} must stand there once, before its end")
    with atomic_file(PAGE) as temporary:
        temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
