"""The figure of non-rigid edits: bindings below one another, edits side by side, details enlarged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.scene.edit_quality import EditQuality

Picture = Array
"""sRGB 0..1. [S, S, 3] float32, all of one figure of the same size."""

WHOLE = {"soft": "soft (the paper's)", "soft from the side": "soft, another side"}
"""Lines that show the whole object."""

DETAIL = {
    "soft": "soft",
    "games": "GaMeS (hard)",
    "refined": "refined (ours)",
    "soft, centres only": "control: soft,\nnot turned",
    "mesh": "mesh, colours\nof the photos",
}
"""Lines that show the framed detail."""

FRAME_COLOUR = "#e08a00"
DETAIL_SHARE = 0.36
"""Edge of the detail as a share of the picture's."""
DETAIL_ASPECT = 0.75
"""Height of the detail over its width."""


@dataclass(frozen=True)
class Column:
    """One edit, a column of the figure.

    Args:
        title: Name of the column.
        pictures: Pictures by line; see `WHOLE` and `DETAIL`.
        quality: Measures by line; lines without measures are left out.
    """

    title: str
    pictures: Mapping[str, Picture]
    quality: Mapping[str, EditQuality]


def write_editing_figure(columns: Sequence[Column], photos: Mapping[str, Picture], out: str | Path) -> None:
    """Draw all edits, with photos of the undeformed object in the first column.

    Args:
        columns: Edits, the undeformed object first.
        photos: Held-out photos, `near` and `side`, framed like the pictures. [S, S, 3] each.
        out: PNG, PDF or SVG.

    Raises:
        InputError: There is no edit.
    """
    if not columns:
        raise InputError(out, "there is no edit to draw", "Name at least one")
    width = 2.1
    lines = len(WHOLE) + len(DETAIL)
    figure, axes = plt.subplots(
        lines,
        len(columns) + 1,
        figsize=(width * (len(columns) + 1) + 0.6, width * (len(WHOLE) + DETAIL_ASPECT * len(DETAIL)) + 0.4),
        height_ratios=[1.0] * len(WHOLE) + [DETAIL_ASPECT] * len(DETAIL),
        squeeze=False,
        layout="constrained",
    )
    figure.set_layout_engine("constrained", w_pad=0.015, h_pad=0.04, wspace=0.0, hspace=0.0)
    for axis in axes.flat:
        axis.set_xticks([])
        axis.set_yticks([])
        for side in axis.spines.values():
            side.set_visible(False)
    axes[0][0].set_title("photo (held out)", fontsize=13)
    axes[0][0].imshow(photos["near"], interpolation="antialiased")
    axes[1][0].imshow(photos["side"], interpolation="antialiased")
    for line, (name, label) in enumerate(WHOLE.items()):
        axes[line][0].set_ylabel(label, fontsize=12)
        for column, axis in zip(columns, axes[line][1:], strict=True):
            axis.imshow(column.pictures[name], interpolation="antialiased")
    for line, (name, label) in enumerate(DETAIL.items(), len(WHOLE)):
        axes[line][0].set_ylabel(label, fontsize=12)
        text = summary([column.quality[name] for column in columns if name in column.quality])
        axes[line][0].text(0.5, 0.5, text, fontsize=10.5, ha="center", va="center", transform=axes[line][0].transAxes)
    for axis, column in zip(axes[0][1:], columns, strict=True):
        axis.set_title(column.title, fontsize=13)
    for number, column in enumerate(columns, 1):
        left, top, edge, height = detail_window(column)
        frame = Rectangle((left - 0.5, top - 0.5), edge, height, fill=False, edgecolor=FRAME_COLOUR, linewidth=1.3)
        axes[0][number].add_patch(frame)
        for line, name in enumerate(DETAIL, len(WHOLE)):
            axis = axes[line][number]
            axis.imshow(column.pictures[name][top : top + height, left : left + edge], interpolation="antialiased")
            for side in axis.spines.values():
                side.set_visible(True)
                side.set_edgecolor(FRAME_COLOUR)
                side.set_linewidth(1.3)
    with atomic_file(out) as temporary:
        figure.savefig(temporary, dpi=130, metadata={"Date": None} if Path(out).suffix == ".svg" else None)
    plt.close(figure)


def summary(found: Sequence[EditQuality]) -> str:
    """Format the measures at rest (the first) and in the worst edit, one per line; none at all mark the reference."""
    if not found:
        return "reference\nof the PSNR"
    rest, edits = found[0], found[1:] or found
    lines = [
        "at rest → worst edit",
        f"holes {rest.holes:.1%} → {max(x.holes for x in edits):.1%}",
        f"see-through {rest.see_through:.1%} → {max(x.see_through for x in edits):.1%}",
        f"overhang {rest.overhang_mm:.1f} → {max(x.overhang_mm for x in edits):.1f} mm",
        f"PSNR {rest.psnr:.1f} → {min(x.psnr for x in edits):.1f} dB",
    ]
    return "\n".join(lines).replace("%", " %")


def detail_window(column: Column) -> tuple[int, int, int, int]:
    """Part of the picture where turning with the mesh matters most: left, top, width, height, px.

    It is where soft splats differ most from splats of which only the centres follow. On the rest mesh, where nothing differs,
    it is the middle.
    """
    size = column.pictures["soft"].shape[0]
    edge = round(DETAIL_SHARE * size)
    height = round(DETAIL_ASPECT * edge)
    difference = np.abs(column.pictures["soft"] - column.pictures["soft, centres only"]).mean(-1)
    table = np.pad(difference, ((1, 0), (1, 0))).cumsum(0, dtype=np.float64).cumsum(1)
    sums = table[height:, edge:] - table[:-height, edge:] - table[height:, :-edge] + table[:-height, :-edge]
    if sums.max() <= 0:
        return (size - edge) // 2, (size - height) // 2, edge, height
    top, left = np.unravel_index(int(np.argmax(sums)), sums.shape)
    return int(left), int(top), edge, height
