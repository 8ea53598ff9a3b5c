"""The page of a scene: what it says, what it draws, and that it stands alone."""

import json

import numpy as np
import pytest
from browser import check, needs_browser

from gsbridge.images import write_image
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.report.figures.mesh_sides import SIDES, draw_sides
from gsbridge.report.pages.scene import PHOTOS, write_scene_page

MASKS_SAY = "masks disagree, see `masks: {points: ...}` & more"


def box(x: float, y: float, z: float) -> Mesh:
    """A box that stands on the table."""
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (0, 1)]) * (x, y, z)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(corners, np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]))


def turned(mesh: Mesh, angle: float) -> Mesh:
    """A mesh that stands otherwise on the table."""
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return Mesh(mesh.vertices @ turn.T, mesh.faces)


def test_sides_show_the_extents_of_a_box():
    size = 160
    picture = draw_sides(box(0.2, 0.1, 0.05), size)
    assert picture.shape == (size, len(SIDES) * size, 3)
    paper = (picture == picture[0, 0]).all(-1)
    widths = [(~paper[:, k * size : (k + 1) * size]).any(0).sum() for k in range(5)]
    # The front shows x, the right side y; the nearer a side the wider it is.
    assert widths[0] == pytest.approx(widths[2], abs=2)
    assert widths[1] == pytest.approx(widths[3], abs=2)
    assert 1.6 < widths[0] / widths[1] < 2.4
    assert not paper[size // 2, 4 * size + size // 2]


@pytest.fixture
def results(tmp_path):
    """What the stages leave of a degraded object."""
    base = tmp_path / "scenes/my_mug"
    rng = np.random.default_rng(0)
    names = [f"{i:04d}.png" for i in range(12)]
    mask = np.zeros((60, 80), np.float32)
    mask[20:40, 30:50] = 1
    for name in names:
        write_image(base / "sfm/images" / name, rng.random((60, 80, 3), dtype=np.float32))
        write_image(base / "masks/images" / name, mask)
    write_image(base / "splats/soft/views/0004.png", rng.random((20, 60, 3), dtype=np.float32))
    for name in ("visual", "collision"):
        write_mesh(base / f"mesh/{name}.ply", turned(box(0.1, 0.05, 0.1), 0.5))
    records = {
        "capture/keyframes": {"frames": names},
        "sfm/sfm": {"registered": 12, "total": 12, "reprojection_px": 0.5},
        "align/align": {"scale_source": "unknown", "status": "degraded", "reasons": ["the scale is unknown & <odd>"]},
        "masks/masks": {
            "consistency": {"mean": 0.7},
            "status": "degraded",
            "reasons": ["masks disagree, see `masks: {points: ...}` & more"],
        },
        "mesh/mesh": {"kind": "object", "visual": {"extents": [0.112, 0.092, 0.1]}},
        "splats/soft/splats": {
            "splats": 9,
            "pictures": ["0004.png"],
            "metrics": {"held_out": {"masked": {"psnr": 27.04}}},
        },
    }
    for name, record in records.items():
        path = base / f"{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"status": "pass", "reasons": [], **record}))
    return base


def test_the_page_says_what_is_wrong_and_what_to_do(results, tmp_path):
    out = tmp_path / "report.html"
    write_scene_page("my_mug", results, out)
    text = out.read_text()
    assert text.count("<img ") == PHOTOS + 2 + 1
    assert "the scale is unknown &amp; &lt;odd&gt;" in text
    assert "<code>gsbridge masks my_mug</code>" in text
    assert "see <code>masks: {points: ...}</code> &amp; more" in text
    assert "27.0 dB on held-out photos" in text
    # As a ruler has them, however the thing stands on the table.
    assert "length × width × height 1.00 × 0.50 × 1.00, relative to the longest" in text
    assert text.count("What to do:") == 2
    assert "not made" in text
    assert "12 of 12 photos placed, points off by 0.50 px" in text
    (results / "asset").mkdir()
    (results / "asset/asset.json").write_text(json.dumps({"status": "pass", "reasons": [], "body": {"mass": 0.0312}}))
    write_scene_page("my_mug", results, out)
    assert "0.031 kg, from its volume and the density in the config" in out.read_text()


def test_a_scene_of_which_nothing_is_there_yet(tmp_path):
    write_scene_page("empty", tmp_path / "scenes/empty", tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text().count("not made</span>") == 8


def test_a_table_has_no_height(tmp_path):
    path = tmp_path / "scenes/desk/mesh/mesh.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps({"status": "pass", "kind": "background", "visual": {"extents": [1.2, 0.9, 0.0]}}))
    write_scene_page("desk", tmp_path / "scenes/desk", tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert "length × width 1.00 × 0.75, relative to the longest" in text
    assert "its foot" not in text


@needs_browser
def test_the_page_in_a_browser(results, tmp_path):
    out = tmp_path / "report.html"
    write_scene_page("my_mug", results, out)
    assert check(out.read_text(), tmp_path)["pictures"] == PHOTOS + 3
