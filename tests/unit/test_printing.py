"""The printed sheet: scale, tags, quiet zones, ruler, texture; each read back from the files or the raster."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import cv2
import numpy as np
import pytest

from gsbridge.capture.printing import sheet_reflectance, sheet_shapes, write_sheet
from gsbridge.cli import main
from gsbridge.errors import InputError
from gsbridge.images import srgb_from_linear, to_u8
from gsbridge.photogrammetry.board import find_tags, standard_board, tag_pixels

PIXELS_PER_M = 3000.0


def sheet_image(board, pixels_per_m):
    """The sheet as an sRGB picture. [H, W, 3] uint8."""
    return np.repeat(to_u8(srgb_from_linear(sheet_reflectance(board, pixels_per_m)))[..., None], 3, axis=2)


def _pixels(board, points):
    """Board frame to raster pixels, row 0 at the top. [..., 2] -> [..., 2]."""
    return (np.asarray(points)[..., :2] * [1, -1] + np.array(board.size) / 2) * PIXELS_PER_M


@pytest.fixture(scope="module", params=["a4", "letter"])
def sheet(request):
    board = standard_board(request.param)
    return board, sheet_reflectance(board, PIXELS_PER_M, oversampling=2)


def test_every_tag_is_read_where_the_layout_says():
    board = standard_board("a4")
    image = sheet_image(board, 2000)
    assert image.shape == (420, 594, 3)
    assert image.dtype == np.uint8
    found = find_tags(image, board)
    assert set(found) == set(board.ids)
    for tag, corners in board.corners().items():
        expected = (corners[:, :2] * [1, -1] + np.array(board.size) / 2) * 2000
        assert np.abs(found[tag] - expected).max() < 0.15


def test_cells_and_quiet_zone_of_the_tags(sheet):
    board, raster = sheet
    cell = board.tag_size / 8
    for index, tag in enumerate(board.ids):
        centre = board.centres[index]
        offsets = (np.arange(10) - 4.5) * cell
        x, y = np.meshgrid(centre[0] + offsets, centre[1] - offsets)
        columns, rows = np.moveaxis(_pixels(board, np.stack([x, y], axis=-1)).astype(int), -1, 0)
        seen = raster[rows, columns]
        expected = np.pad(tag_pixels(tag).astype(float), 1, constant_values=1.0)  # one white cell all round
        assert np.abs(seen - expected).max() < 0.01
        # The whole rim of one cell is paper, not only its middle.
        (left, top), (right, bottom) = _pixels(board, centre + 5 * cell * np.array([[-1, 1], [1, -1]]))
        patch = raster[int(np.ceil(top)) : int(bottom), int(np.ceil(left)) : int(right)].copy()
        rim = int(cell * PIXELS_PER_M) - 2
        patch[rim:-rim, rim:-rim] = 1.0
        assert patch.min() > 0.99


def test_the_black_of_a_tag_has_the_area_of_its_cells():
    board = standard_board("a4")
    cell = board.tag_size / 8
    black = [shape for shape in sheet_shapes(board) if shape.grey == 0.0 and len(shape.outlines[0]) >= 4]
    tags = [shape for shape in black if np.isclose(np.ptp(np.concatenate(shape.outlines), axis=0), board.tag_size).all()]
    assert len(tags) == len(board.ids)
    for shape, tag in zip(tags, board.ids, strict=True):
        area = abs(sum(0.5 * np.sum(o[:, 0] * np.roll(o[:, 1], -1) - np.roll(o[:, 0], -1) * o[:, 1]) for o in shape.outlines))
        assert np.isclose(area, (tag_pixels(tag) == 0).sum() * cell**2, rtol=1e-9)


def test_ruler_measures_100_mm(sheet):
    board, raster = sheet
    row = int(_pixels(board, [0.0, -0.0395])[1])
    dark = raster[row] < 0.88
    runs = np.flatnonzero(np.diff(np.r_[0, dark.astype(int), 0])).reshape(-1, 2)
    middles = runs.mean(1) / PIXELS_PER_M - board.size[0] / 2
    ticks = middles[np.abs(middles) < 0.0505]
    assert len(ticks) == 101
    assert abs((ticks[-1] - ticks[0]) - 0.100) < 2e-4
    assert np.abs(np.diff(ticks) - 0.001).max() < 4e-4


def test_texture_gives_features_between_the_tags():
    board = standard_board("a4")
    image = cv2.cvtColor(sheet_image(board, 1500), cv2.COLOR_RGB2GRAY)
    middle = np.zeros_like(image)
    middle[image.shape[0] // 2 - 50 : image.shape[0] // 2 + 50] = 255
    assert len(cv2.SIFT_create().detect(image, middle)) > 150


@pytest.mark.parametrize("name", ["a4", "letter"])
def test_svg_has_true_size_and_all_shapes(tmp_path, name):
    board = standard_board(name)
    write_sheet(board, tmp_path / "board.svg")
    root = ElementTree.parse(tmp_path / "board.svg").getroot()
    width, height = (1e3 * side for side in board.size)
    assert root.get("width") == f"{width:g}mm"
    assert root.get("height") == f"{height:g}mm"
    assert [float(v) for v in root.get("viewBox").split()] == pytest.approx([0, 0, width, height])
    paths = root.findall("{http://www.w3.org/2000/svg}path")
    assert len(paths) == len(sheet_shapes(board))
    # The outer box of each tag's path, read from the file, is the tag of the layout: one unit is one millimetre.
    boxes = []
    for path in paths:
        points = np.array(re.findall(r"(-?[\d.]+),(-?[\d.]+)", path.get("d")), dtype=float)
        if np.allclose(np.ptp(points, axis=0), 1e3 * board.tag_size, atol=2e-3):
            boxes.append((points.min(0) + points.max(0)) / 2)
    expected = 1e3 * (board.centres * [1, -1] + np.array(board.size) / 2)
    assert np.allclose(boxes, expected, atol=2e-3)


def test_pdf_has_true_size_and_a_sound_table(tmp_path):
    board = standard_board("a4")
    write_sheet(board, tmp_path / "board.pdf")
    content = (tmp_path / "board.pdf").read_bytes()
    box = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", content)
    assert [float(v) for v in box.groups()] == pytest.approx([841.8898, 595.2756], abs=1e-3)  # A4 in points
    assert b"/PrintScaling /None" in content
    start = int(content.rsplit(b"startxref\n", 1)[1].split()[0])
    assert content[start : start + 4] == b"xref"
    for number, offset in enumerate(re.findall(rb"(\d{10}) 00000 n", content), start=1):
        assert content[int(offset) :].startswith(b"%d 0 obj" % number)
    length = int(re.search(rb"/Length (\d+)", content).group(1))
    begin = content.index(b"stream\n") + len(b"stream\n")
    assert content[begin + length :].startswith(b"\nendstream")
    assert content[begin : begin + length].count(b"f*") == len(sheet_shapes(board))


def test_other_suffixes_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"\.pdf or \.svg"):
        write_sheet(standard_board("a4"), tmp_path / "board.png")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [["taken/board.pdf"], ["board.pdf", "--layout", "folder"]])
def test_a_file_that_cannot_be_written_is_named_as_it_was_given(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "taken").touch()
    assert main(["board", *arguments]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"gsbridge: {arguments[-1]}: it cannot be written: ")
    assert said.count("\n") == 1
    assert ".part" not in said
