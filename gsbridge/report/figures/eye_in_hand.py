"""What the wrist camera sees in the mirror and what each renderer draws at the same states, with their PSNR."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.images import psnr, read_image
from gsbridge.report.tables.rows import write_rows

COMPARED = ("gs", "mesh_vertex_shaded", "mesh_shaded", "gs_unshaded", "mesh_vertex", "mesh")
"""Renderers with shadows, then without. Within each half they differ in the renderer alone."""
TITLES = {
    "photo": "mirror",
    "gs": "splats",
    "mesh_vertex_shaded": "mesh, vertex colours",
    "mesh_shaded": "mesh, one colour",
    "gs_unshaded": "splats, no shadows",
    "mesh_vertex": "mesh, vertex colours,\nno shadows",
    "mesh": "mesh, one colour,\nno shadows",
}
COLUMNS = ("object", "background", "renderer", "views", "psnr", "psnr_min", "psnr_max")
SHOWN = 8


@dataclass(frozen=True)
class Looked:
    """Pictures of one object on one background.

    Args:
        item, background: Names of the scenes.
        drawn: Folder of `{index}_{renderer}.png`.
        photos: Folder of `{index}.png`.
    """

    item: str
    background: str
    drawn: Path
    photos: Path

    def views(self) -> list[dict[str, Array]]:
        """Read one mapping per state, from `photo` and the renderers' names to pictures. [H, W, 3] 0..1 each.

        Raises:
            InputError: A picture is missing.
        """
        out = []
        for path in sorted(self.photos.glob("*.png")):
            pictures = {name: self.drawn / f"{path.stem}_{name}.png" for name in COMPARED}
            out.append({"photo": read_image(path), **{name: read_image(file) for name, file in pictures.items()}})
        if not out:
            raise InputError(self.photos, "the folder holds no photo", "Photograph the states again")
        return out


def write_eye_in_hand(pairs: Sequence[Looked], figure: str | Path, rows: str | Path) -> None:
    """Draw eight states of each pair, the mirror's photo above the renderers, and write their PSNR over all states.

    Args:
        pairs: Objects on backgrounds.
        figure: PNG.
        rows: CSV with `COLUMNS`; PSNR in dB against the photos, mean over the states.

    Raises:
        InputError: There is no pair, or a picture is missing.
    """
    if not pairs:
        raise InputError(figure, "there is nothing to compare", "Name a cell in the configuration")
    table, blocks = [], []
    for pair in pairs:
        views = pair.views()
        values = {name: np.array([psnr(view[name], view["photo"]) for view in views]) for name in COMPARED}
        for name, found in values.items():
            figures = {"psnr": float(found.mean()), "psnr_min": float(found.min()), "psnr_max": float(found.max())}
            row = {"object": pair.item, "background": pair.background, "renderer": name, "views": len(views), **figures}
            table.append(row)
        chosen = [views[i] for i in np.unique(np.linspace(0, len(views) - 1, SHOWN).round().astype(int))]
        blocks.append((pair, chosen, {name: float(found.mean()) for name, found in values.items()}))
    names = ("photo", *COMPARED)
    height = 0.95 * len(names) + 0.35
    page = plt.figure(figsize=(SHOWN * 0.95 + 1.5, height * len(blocks)), layout="constrained")
    for part, (pair, chosen, means) in zip(page.subfigures(len(blocks), 1, squeeze=False).flat, blocks, strict=True):
        axes = part.subplots(len(names), SHOWN, squeeze=False, gridspec_kw={"wspace": 0.02, "hspace": 0.02})
        part.suptitle(f"{pair.item} on {pair.background}".replace("_", " "), fontsize=10)
        for line, name in zip(axes, names, strict=True):
            for axis in line:
                axis.axis("off")
            for axis, view in zip(line, chosen, strict=False):
                axis.imshow(view[name], interpolation="nearest")
            label = TITLES[name] + (f"\n{means[name]:.1f} dB" if name in means else "")
            line[0].text(-0.08, 0.5, label, transform=line[0].transAxes, ha="right", va="center", fontsize=8)
    with atomic_file(figure) as temporary:
        page.savefig(temporary, dpi=130)
    plt.close(page)
    write_rows(rows, COLUMNS, table)
