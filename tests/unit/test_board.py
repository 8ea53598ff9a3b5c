"""The board's layout, and the accuracy with which its tags are found."""

import cv2
import numpy as np
import pytest

from gsbridge.cameras import Camera, camera_centre, look_at
from gsbridge.capture.printing import sheet_reflectance
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.images import srgb_from_linear, to_u8
from gsbridge.photogrammetry.board import SHEETS_M, find_tags, standard_board, tag_pixels, write_board


def photo_of_board(camera, cam_from_board, board, samples=4):
    """Analytic photo: every pixel averages the light of samples x samples rays that hit the sheet, then is encoded."""
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    light = np.zeros((camera.height, camera.width))
    rays = camera.pixel_rays()
    rotation, eye = cam_from_board[:3, :3], camera_centre(cam_from_board)
    for dv in offsets:
        for du in offsets:
            directions = (rays + np.array([du / camera.fx, dv / camera.fy, 0.0])) @ rotation
            hit = eye[:2] - directions[..., :2] * (eye[2] / directions[..., 2:])
            value = np.full(light.shape, 0.8)
            value[(np.abs(hit) > np.array(board.size) / 2).any(-1)] = 0.3
            for tag, centre in zip(board.ids, board.centres, strict=True):
                cell = (hit - centre) / board.tag_size * [1, -1] * 8 + 4
                inside = ((cell >= 0) & (cell < 8)).all(-1)
                column, row = np.floor(cell[inside]).astype(int).T
                value[inside] = np.where(tag_pixels(tag)[row, column] > 0, 0.8, 0.03)
            light += value / samples**2
    return to_u8(srgb_from_linear(np.repeat(light[..., None], 3, axis=2)))


@pytest.mark.parametrize(
    ("eye", "least"),
    # The far tags of the last, flat view are smaller than two pixels a cell and refused rather than guessed.
    [((0.05, -0.3, 0.35), 8), ((-0.25, 0.2, 0.4), 8), ((0.0, -0.4, 0.25), 4)],
)
def test_tags_are_found_in_order_and_without_bias(eye, least):
    board = standard_board()
    camera = Camera(640, 480, 560.0, 560.0, 321.0, 239.0)
    pose = look_at(eye, [0, 0, 0])
    found = find_tags(photo_of_board(camera, pose, board), board)
    assert len(found) >= least
    errors = []
    outward = []
    for tag in found:
        corners = board.corners()[tag]
        expected = camera.project(corners @ pose[:3, :3].T + pose[:3, 3])
        errors.append(found[tag] - expected)
        radius = expected - expected.mean(0)
        outward.append((errors[-1] * radius).sum(-1) / np.linalg.norm(radius, axis=-1))
    # Each corner within a tenth of a pixel, and no systematic shift or shrinking, which would bias the scale.
    assert np.abs(errors).max() < 0.1
    assert np.abs(np.mean(errors, axis=(0, 1))).max() < 0.03
    assert abs(np.mean(outward)) < 0.03


@pytest.mark.parametrize("sheet", sorted(SHEETS_M))
def test_tags_lie_on_the_sheet_with_a_white_margin(sheet):
    board = standard_board(sheet)
    corners = np.concatenate(list(board.corners().values()))[:, :2]
    margin = np.array(board.size) / 2 - np.abs(corners).max(0)
    assert margin.min() >= board.tag_size / 8
    distance = np.linalg.norm(board.centres[:, None] - board.centres, axis=-1)
    np.fill_diagonal(distance, 1.0)
    assert distance.min() > board.tag_size * 1.25


def test_layout_is_written_as_it_is(tmp_path):
    board = standard_board("letter")
    write_board(tmp_path / "board.json", board)
    found = read_json(tmp_path / "board.json")
    assert (found["sheet"], found["tag_size_m"], found["ids"]) == ("letter", board.tag_size, list(board.ids))
    np.testing.assert_array_equal(found["centres_m"], board.centres)
    with pytest.raises(InputError, match="unknown"):
        standard_board("a3")


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("shift", [-0.0006, -0.0002, 0.0002])
def test_a_shadow_across_the_middle_of_a_tag_hides_at_most_this_tag(axis, shift):
    """The rest of the sheet lies in plain light or in plain shadow, a quarter as bright."""
    board, per_metre = standard_board(), 3000.0
    sheet = sheet_reflectance(board, per_metre)
    across = np.arange(sheet.shape[1 - axis]) + 0.5
    place = board.centres[1] * [1, -1] + np.array(board.size) / 2
    light = np.where(across < per_metre * (place[axis] + shift), 1.0, 0.25)
    seen = cv2.GaussianBlur((0.8 * sheet * (light[None] if axis == 0 else light[:, None])).astype(np.float32), (0, 0), 0.7)
    found = find_tags(to_u8(srgb_from_linear(np.repeat(seen[..., None], 3, axis=2))), board)
    clear = {tag for tag, centre in enumerate(board.centres) if abs(centre[axis] - board.centres[1][axis]) > board.tag_size}
    assert clear <= found.keys()
    for tag in clear:
        printed = (board.corners()[tag][:, :2] * [1, -1] + np.array(board.size) / 2) * per_metre
        assert np.abs(found[tag] - printed).max() < 0.1
