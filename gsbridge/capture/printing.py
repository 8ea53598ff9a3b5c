"""The printable sheet of a board: tags, a ruler, texture for feature matching, and instructions.

The sheet is defined by one list of filled outlines (`sheet_shapes`). The PDF, the SVG and the raster all draw exactly that list
with the same even-odd fill, so that a camera in the mirror sees what a printer prints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.images import srgb_from_linear
from gsbridge.photogrammetry.board import Board, tag_pixels

RULER_M = 0.100
"""Length of the printed ruler, m."""

_TEXTURE_SEED = 20240611
_MARGIN_M = 0.006  # most printers leave 4 to 5 mm of the sheet white
_TAG_CLEAR_CELLS = 1.25  # white rim of a tag that nothing else may touch, in cells; the detector needs one
_RULER_BOX = (-0.064, -0.0515, 0.064, -0.0365)  # left, bottom, right, top in the board frame, m
_TEXT_BOX = (-0.100, 0.0395, 0.100, 0.0515)
_ADVICE = (
    "Print at 100 % (actual size, no 'fit to page') on matt paper, glue it flat, and check the ruler: it must measure 100 mm.",
    "Lay it beside the object, keep it still while you film. AprilTag 36h11, gsbridge board",
)


@dataclass(frozen=True)
class Shape:
    """One filled area of the sheet.

    Args:
        grey: Ink, 0 black to 1 paper white, as reflectance relative to the paper.
        outlines: Closed outlines, board frame, m, filled by the even-odd rule. Each [K, 2].
    """

    grey: float
    outlines: tuple[Array, ...]


def _rectangle(left: float, bottom: float, right: float, top: float) -> Array:
    """Outline of a rectangle. [4, 2]."""
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def _region_outlines(cells: Array) -> list[Array]:
    """Outlines of the regions of ones in a small grid. [R, C] -> list of [K, 2] x, y, y down; the region lies on the left.

    Cells are merged before they are filled, because cells painted one by one would show hairlines where they meet.
    """
    rows, columns = cells.shape
    padded = np.pad(cells.astype(bool), 1)
    turns: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for row in range(rows):
        for column in range(columns):
            if not cells[row, column]:
                continue
            x, y = column, row
            sides = (
                (padded[row, column + 1], (x, y), (x + 1, y)),
                (padded[row + 1, column + 2], (x + 1, y), (x + 1, y + 1)),
                (padded[row + 2, column + 1], (x + 1, y + 1), (x, y + 1)),
                (padded[row + 1, column], (x, y + 1), (x, y)),
            )
            for inside, begin, end in sides:
                if not inside:
                    turns.setdefault(begin, []).append(end)
    outlines = []
    while turns:
        begin = next(iter(turns))
        here = begin
        outline: list[tuple[int, int]] = []
        way = (0, 0)
        while not outline or here != begin:
            outline.append(here)
            # Where two regions touch at a corner, the way turns right, so that each region keeps its own outline.
            choices = turns[here]
            right = (here[0] - way[1], here[1] + way[0])
            there = right if right in choices else choices[0]
            choices.remove(there)
            if not choices:
                del turns[here]
            way = (there[0] - here[0], there[1] - here[1])
            here = there
        outlines.append(np.array(outline, dtype=np.float64))
    return outlines


def _tag_shape(board: Board, index: int) -> Shape:
    """Black part of one tag."""
    cell = board.tag_size / 8
    corner = board.centres[index] + np.array([-0.5, 0.5]) * board.tag_size
    black = _region_outlines(1 - tag_pixels(board.ids[index]))
    return Shape(0.0, tuple(corner + outline * [cell, -cell] for outline in black))


def _text_shape(text: str, x: float, y: float, height: float, anchor: str = "middle") -> Shape:
    """Text as outlines, so that no program that shows the sheet needs a font.

    Args:
        text: The text.
        x, y: Anchor on the base line, board frame, m.
        height: Font size, m.
        anchor: `middle` or `start`.
    """
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    path = TextPath((0, 0), text, size=100, prop=FontProperties(family="DejaVu Sans"))
    polygons = map(np.asarray, path.to_polygons(closed_only=True))
    outlines = [polygon[:-1] * (height / 100) for polygon in polygons if len(polygon) > 3]
    points = np.concatenate(outlines)
    shift = (points[:, 0].min() + points[:, 0].max()) / 2 if anchor == "middle" else points[:, 0].min()
    return Shape(0.0, tuple(outline + np.array([x - shift, y]) for outline in outlines))


def _ruler_shapes() -> list[Shape]:
    """A 100 mm ruler with a tick each millimetre and a figure each centimetre."""
    left, base = -RULER_M / 2, _RULER_BOX[3] - 0.0045
    thin = 0.00018
    ticks = []
    for mm in range(101):
        length = 0.0042 if mm % 10 == 0 else 0.0032 if mm % 5 == 0 else 0.0022
        x = left + mm * 1e-3
        ticks.append(_rectangle(x - thin / 2, base, x + thin / 2, base + length))
    shapes = [Shape(0.0, (tick,)) for tick in ticks]
    shapes.append(Shape(0.0, (_rectangle(left - thin / 2, base - thin, left + RULER_M + thin / 2, base),)))
    shapes += [_text_shape(str(cm), left + cm * 0.01, base - 0.0038, 0.0030) for cm in range(0, 11)]
    shapes.append(_text_shape("cm: 100 mm from first to last tick", 0.0, base - 0.0078, 0.0028))
    return shapes


def _texture_shapes(board: Board) -> list[Shape]:
    """Random grey polygons of many sizes, with corners at all scales; none is near a tag, the ruler or the text."""
    rng = np.random.default_rng(_TEXTURE_SEED)
    half_w, half_h = board.size[0] / 2 - _MARGIN_M, board.size[1] / 2 - _MARGIN_M
    clear = board.tag_size * (0.5 + _TAG_CLEAR_CELLS / 8)
    boxes = [(x - clear, y - clear, x + clear, y + clear) for x, y in board.centres] + [_RULER_BOX, _TEXT_BOX]
    low, high = np.array([b[:2] for b in boxes]), np.array([b[2:] for b in boxes])
    shapes = []
    for radius_mm, count in ((8.0, 350), (4.5, 900), (2.2, 1500), (1.2, 2200)):
        for _ in range(count):
            radius = radius_mm * 1e-3 * rng.uniform(0.7, 1.2)
            centre = rng.uniform([-half_w, -half_h], [half_w, half_h])
            corners = int(rng.integers(3, 8))
            grey = float(rng.choice([0.0, 0.12, 0.3, 0.55, 0.8, 1.0]))
            angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
            reach = radius * rng.uniform(0.45, 1.0, corners)
            outside = (np.abs(centre) + radius > [half_w, half_h]).any()
            gap = np.maximum(np.maximum(low - centre, centre - high), 0)
            if outside or (np.hypot(gap[:, 0], gap[:, 1]) < radius).any():
                continue
            shapes.append(Shape(grey, (centre + reach[:, None] * np.c_[np.cos(angles), np.sin(angles)],)))
    return shapes


def sheet_shapes(board: Board) -> list[Shape]:
    """Everything on the sheet, in painting order."""
    top = _TEXT_BOX[3]
    return [
        *_texture_shapes(board),
        *(_tag_shape(board, index) for index in range(len(board.ids))),
        *_ruler_shapes(),
        _text_shape(_ADVICE[0], 0.0, top - 0.0045, 0.0030),
        _text_shape(_ADVICE[1], 0.0, top - 0.0095, 0.0030),
    ]


def write_sheet(board: Board, path: str | Path) -> None:
    """Write the printable sheet at exact scale; `.pdf` or `.svg` by the suffix, whole or not at all.

    Raises:
        InputError: Another suffix.
    """
    target = Path(path)
    kinds = {".svg": _svg, ".pdf": _pdf}
    if target.suffix.lower() not in kinds:
        raise InputError(target, f"a board cannot be written as '{target.suffix}'", "Use a name that ends in .pdf or .svg")
    content = kinds[target.suffix.lower()](board, sheet_shapes(board))
    with atomic_file(target) as temporary:
        temporary.write_bytes(content)


def _svg(board: Board, shapes: Sequence[Shape]) -> bytes:
    """SVG in millimetres: the view box equals the sheet, so one unit is one millimetre."""
    width, height = (1e3 * side for side in board.size)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" '
        f'viewBox="0 0 {width:g} {height:g}">',
        f'<rect width="{width:g}" height="{height:g}" fill="#ffffff"/>',
    ]
    for shape in shapes:
        level = round(255 * float(srgb_from_linear(np.array(shape.grey))))
        data = " ".join(
            "M" + " L".join(f"{x:.3f},{y:.3f}" for x, y in 1e3 * outline * [1, -1] + [width / 2, height / 2]) + " Z"
            for outline in shape.outlines
        )
        lines.append(f'<path fill="#{level:02x}{level:02x}{level:02x}" fill-rule="evenodd" d="{data}"/>')
    return ("\n".join(lines) + "\n</svg>\n").encode()


def _pdf(board: Board, shapes: Sequence[Shape]) -> bytes:
    """A PDF 1.4 of one page with filled paths only, in user units of 1/72 inch; it asks the print dialogue not to scale."""
    unit = 72 / 0.0254
    width, height = (unit * side for side in board.size)
    parts = []
    for shape in shapes:
        parts.append(f"{float(srgb_from_linear(np.array(shape.grey))):.4f} g")
        for outline in shape.outlines:
            points = unit * outline + [width / 2, height / 2]
            parts.append(f"{points[0, 0]:.4f} {points[0, 1]:.4f} m")
            parts += [f"{x:.4f} {y:.4f} l" for x, y in points[1:]]
            parts.append("h")
        parts.append("f*")
    stream = "\n".join(parts).encode()
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 4 0 R /Resources << >> >>".encode(),
        b"<< /Length %d >>\nstream\n" % len(stream) + stream + b"\nendstream",
    ]
    out = bytearray(b"%PDF-1.4\n")
    offsets = []
    for number, body in enumerate(objects, start=1):
        offsets.append(len(out))
        out += b"%d 0 obj\n" % number + body + b"\nendobj\n"
    table = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    out += b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, table)
    return bytes(out)


def sheet_reflectance(board: Board, pixels_per_m: float, oversampling: int = 4) -> Array:
    """Reflectance of the sheet relative to white paper, each pixel the mean over its area. [H, W] float32, top row first.

    Args:
        board: Layout.
        pixels_per_m: Resolution of the result, pixels per metre.
        oversampling: Drawing resolution per pixel and direction before the mean.
    """
    from matplotlib.backends.backend_agg import RendererAgg
    from matplotlib.path import Path as Outline
    from matplotlib.transforms import Affine2D

    width, height = (max(1, round(side * pixels_per_m)) for side in board.size)
    wide, high = width * oversampling, height * oversampling
    # Agg fills with exact area coverage; OpenCV does not, and its polygons are half a pixel too wide.
    renderer = RendererAgg(wide, high, 72)
    place = Affine2D().translate(board.size[0] / 2, board.size[1] / 2).scale(wide / board.size[0], high / board.size[1])
    for shape in [Shape(1.0, (_rectangle(-1, -1, 1, 1),)), *sheet_shapes(board)]:
        style = renderer.new_gc()
        style.set_linewidth(0)
        style.set_snap(False)
        outline = Outline.make_compound_path(*(Outline(np.vstack([o, o[:1]]), closed=True) for o in shape.outlines))
        renderer.draw_path(style, outline, place, (shape.grey,) * 3)
    canvas = np.asarray(renderer.buffer_rgba())[..., 0].astype(np.float32) / 255
    return cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
