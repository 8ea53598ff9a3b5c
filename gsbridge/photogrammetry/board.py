"""The printable board: its layout, and its detection in images. Sheets are written by `gsbridge.capture.printing`.

The board frame has its origin at the centre of the sheet, x to the right and y up as printed, z out of the paper towards
the viewer. The metric scale comes from the layout instead of the size of single tags, because distances between tags are
several times less sensitive to blurred edges (`docs/capture.md`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import write_json
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb

SHEETS_M = {"a4": (0.297, 0.210), "letter": (0.2794, 0.2159)}
"""Sheet sizes, landscape: width, height, m."""

MIN_TAGS = 3
"""Least number of tags that a photo must show; with fewer, a flat target's pose is poorly determined or ambiguous."""

MIN_PROFILES = 6
"""Least number of the 24 profiles across a tag's edge that must agree on its place; where they do not, a shadow's edge or
something else crosses the tag's edge."""


@dataclass(frozen=True)
class Board:
    """Layout of AprilTags (family 36h11) on one sheet.

    Args:
        sheet: `a4` or `letter`.
        tag_size: Edge of a tag's black square, m.
        ids: Tag ids. [N].
        centres: Tag centres in the board frame, m. [N, 2].
    """

    sheet: str
    tag_size: float
    ids: tuple[int, ...]
    centres: Array

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the sheet, m."""
        return SHEETS_M[self.sheet]

    def corners(self) -> dict[int, Array]:
        """Corners of each tag in the board frame: top left, top right, bottom right, bottom left as printed, m. [4, 3]."""
        half = self.tag_size / 2
        square = np.array([[-half, half], [half, half], [half, -half], [-half, -half]])
        return {tag: np.c_[square + self.centres[index], np.zeros(4)] for index, tag in enumerate(self.ids)}


def standard_board(sheet: str = "a4") -> Board:
    """The board that `gsbridge board` prints: eight tags of 32 mm round the rim of a landscape sheet.

    Raises:
        InputError: The sheet size is unknown.
    """
    if sheet not in SHEETS_M:
        raise InputError("board", f"the sheet size '{sheet}' is unknown", f"Use one of {', '.join(sorted(SHEETS_M))}")
    # One layout serves both sheets: in each direction it fits the smaller of the two with 12 mm of margin.
    dx, dy = 0.108, 0.074
    centres = np.array([[-dx, dy], [-dx / 3, dy], [dx / 3, dy], [dx, dy], [dx, -dy], [dx / 3, -dy], [-dx / 3, -dy], [-dx, -dy]])
    return Board(sheet, 0.032, tuple(range(8)), centres)


def optional_board(sheet: str | None) -> Board | None:
    """The board of a scene, or None where the scene was filmed without one."""
    return None if sheet is None else standard_board(sheet)


def write_board(path: str | Path, board: Board) -> None:
    """Write a board's layout as JSON."""
    write_json(
        path, {"sheet": board.sheet, "tag_size_m": board.tag_size, "ids": list(board.ids), "centres_m": board.centres.tolist()}
    )


def tag_pixels(tag: int) -> Array:
    """Black and white cells of a tag with its black border, 0 or 1. [8, 8] uint8."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    return (cv2.aruco.generateImageMarker(dictionary, tag, 8) > 127).astype(np.uint8)


def find_tags(image: Array, board: Board) -> dict[int, Array]:
    """Find the board's tags in a photo.

    Args:
        image: uint8 RGB. [H, W, 3].
        board: Layout; other ids are ignored.

    Returns:
        Corners of each tag found, px with pixel centres at +0.5, in the order of `Board.corners`. [4, 2] each.

    OpenCV decodes the tags; the corners are computed here, as intersections of lines fitted to the four outer edges. An edge
    blurred in linear light and then sRGB-encoded looks shifted into the black square, because half the light is encoded as 0.73
    instead of 0.5; corners found on the encoded image sit a quarter pixel inward. The edges are therefore fitted in linear
    light.
    """
    light = linear_from_srgb(image.astype(np.float32) / 255.0) @ np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), cv2.aruco.DetectorParameters()
    )
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    # OpenCV often fails to decode tags of some 20 px; enlarged twofold, they are read (frames 0.8 m away: 7 of 8 instead of 3).
    enlarge = 2 if max(grey.shape) <= 1600 else 1
    quads, ids, _ = detector.detectMarkers(cv2.resize(grey, None, fx=enlarge, fy=enlarge, interpolation=cv2.INTER_CUBIC))
    if ids is None:
        return {}
    wanted = set(board.ids)
    found = {}
    for quad, tag in zip(quads, ids.ravel(), strict=True):
        if int(tag) in wanted:
            corners = refine_corners(light, (quad.reshape(4, 2).astype(np.float64) + 0.5) / enlarge)
            if corners is not None:
                found[int(tag)] = corners
    return found


def refine_corners(light: Array, corners: Array) -> Array | None:
    """Corners of a dark square on white as the intersections of lines fitted to its edges.

    Args:
        light: Grey image in linear light. [H, W].
        corners: First guess, px with pixel centres at +0.5, within about two pixels. [4, 2].

    Returns:
        Refined corners [4, 2], or None where the square is too small, cut by the image's border, or has no clear edge.

    The edge is placed where a sharp step would give the same total light across it; a symmetric blur does not move this place.
    """
    height, width = light.shape
    for _ in range(2):
        centre = corners.mean(0)
        lines = []
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            along = end - start
            length = float(np.linalg.norm(along))
            along = along / length
            outward = np.array([along[1], -along[0]])
            outward *= np.sign(outward @ ((start + end) / 2 - centre))
            # A profile begins in the middle of the tag's black border, which is one cell of eight wide, foreshortened across
            # this edge. Further inside, the blur of white cells would be mistaken for light of the edge.
            cell = np.abs((corners - (start + end) / 2) @ outward).max() / 8
            if cell < 2.0:
                return None
            inside, outside = min(2.5, 0.5 * cell), min(2.5, 0.8 * cell)
            steps = np.linspace(-inside, outside, 21)
            base = start + along * (np.linspace(0.12, 0.88, 24) * length)[:, None]
            samples = base[:, None] + steps[:, None] * outward
            if samples.min() < 1 or (samples > [width - 1, height - 1]).any():
                return None
            grid = (samples - 0.5).astype(np.float32)
            profiles = cv2.remap(light, grid[..., 0], grid[..., 1], cv2.INTER_LINEAR)
            dark, bright = np.median(profiles[:, :2]), np.median(profiles[:, -2:])
            if bright - dark < 0.05:
                return None
            share = np.clip((profiles - dark) / (bright - dark), -0.2, 1.2)
            # Trapezoid rule: light on the profile = bright * (outside - position of the edge).
            area = (share[:, 1:] + share[:, :-1]).sum(1) * (inside + outside) / 40
            edge = base + (outside - area)[:, None] * outward
            keep = np.abs(area - np.median(area)) < 0.7
            if keep.sum() < MIN_PROFILES:
                return None
            middle = edge[keep].mean(0)
            direction = np.linalg.svd(edge[keep] - middle, full_matrices=False)[2][0]
            normal = np.array([-direction[1], direction[0]])
            lines.append((normal, float(normal @ middle)))
        refined = []
        for index in range(4):
            (n1, d1), (n2, d2) = lines[index - 1], lines[index]
            refined.append(np.linalg.solve(np.stack([n1, n2]), [d1, d2]))
        if np.linalg.norm(np.array(refined) - corners, axis=1).max() > 3.0:
            return None
        corners = np.array(refined)
    return corners
