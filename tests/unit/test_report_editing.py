"""The figure of non-rigid edits: its figures on surfaces whose answer is known, and a small scene drawn from end to end."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import trimesh

from gsbridge.cameras import Camera, View, look_at, write_views
from gsbridge.configuration.measuring import EditingSettings
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.images import read_image_u8, write_image
from gsbridge.meshes import Mesh
from gsbridge.report.figures.editing import COMPARED, CONTROL, REST, edits, write_editing
from gsbridge.report.figures.editing_drawing import DETAIL, WHOLE, Column, detail_window, summary, write_editing_figure
from gsbridge.scene.deform import deform, deformed_vertices
from gsbridge.scene.edit_quality import EditQuality, divide, framed, measure_edit, window_of
from gsbridge.scene.meshes import MeshComposition
from gsbridge.splats.binding import Binding, create_binding, write_binding

CAMERA = Camera(200, 150, 300.0, 300.0, 100.0, 75.0)
CENTRE = np.array([0.1, 0.2, 0.05])


def ball(level: int = 4) -> Mesh:
    """An egg 8 cm wide and 10 cm high on the table, with soft stripes; each level has four times the faces."""
    sphere = trimesh.creation.icosphere(level)
    vertices = np.asarray(sphere.vertices) * [0.04, 0.04, 0.05] + CENTRE
    angle = np.arctan2(*(vertices - CENTRE).T[:2])
    colours = 0.5 + 0.35 * np.stack([np.sin(3 * angle), np.cos(2 * angle), np.sin(60 * vertices[:, 2])], axis=1)
    return Mesh(vertices, np.asarray(sphere.faces, np.int64), colours.astype(np.float32))


def bound(kind: str, mesh: Mesh, width: float = 1.7) -> Binding:
    """Opaque splats, wider than their faces, in the middles of a whole mesh's faces and in its colours."""
    binding = create_binding(kind, mesh, 1, band=0.01, seed=0)
    count = len(binding)
    binding.parameters["weights"] = torch.full((count, 3), 1 / 3)
    binding.parameters["opacity"] = torch.full((count,), 5.0)
    binding.parameters["colour"] = torch.as_tensor(mesh.colours[mesh.faces].mean(1))
    if kind == "refined":
        binding.parameters["stretch"] += np.log(width)
    else:
        binding.parameters["multiplier"] *= width
    return binding


def looks(count: int) -> list[tuple[Camera, np.ndarray]]:
    """Cameras round the egg, 35 cm away."""
    angles = 2 * np.pi * np.arange(count) / count
    eyes = CENTRE + 0.35 * np.stack([0.8 * np.cos(angles), 0.8 * np.sin(angles), np.full(count, 0.6)], axis=1)
    return [(CAMERA, look_at(eye, CENTRE)) for eye in eyes]


@pytest.mark.parametrize("title", list(edits(0.3)))
def test_bound_splats_follow_every_edit_without_holes_and_spikes(title: str) -> None:
    mesh = ball()
    binding, deformation = bound("soft", mesh), edits(0.3)[title]
    surface = Mesh(deformed_vertices(binding, deformation), mesh.faces)
    coloured = dataclasses.replace(surface, colours=mesh.colours)
    found = measure_edit(deform(binding, deformation), binding.face_index, surface, coloured, looks(3))
    assert found.holes == 0
    assert found.see_through < 0.002
    # A disc's standard deviation is about a millimetre, more where it is stretched: its half-opaque rim ends after two.
    assert found.spill < 0.0005
    assert found.overhang_mm < 2.5
    assert found.psnr > 27


def test_missing_splats_are_holes_and_missing_faces_are_seen_through() -> None:
    mesh = ball()
    binding = bound("games", mesh)
    cloud, index = binding.evaluate(), binding.face_index
    whole = measure_edit(cloud, index, mesh, mesh, looks(4))
    upper = cloud.means[:, 2] > CENTRE[2]
    gone = measure_edit(cloud.subset(~upper), index[~upper], mesh, mesh, looks(4))
    # From above, the upper half fills most of the silhouette, but through it the far inside of the lower half is seen.
    assert whole.see_through < 0.002
    assert 0.3 < gone.see_through < 0.9
    assert 0.05 < gone.holes < gone.see_through
    assert gone.psnr < whole.psnr - 3
    # One far splat is a spike of known length, seen from a direction square to it.
    means = cloud.means.copy()
    means[0] = CENTRE + np.array([0, 0.09, 0])
    scales = cloud.scales.copy()
    scales[0] = 0.004
    spike = measure_edit(dataclasses.replace(cloud, means=means, scales=scales), index, mesh, mesh, looks(1))
    assert spike.spill > 0.005
    assert spike.overhang_mm == pytest.approx(50 + 8, abs=6)
    with pytest.raises(ValueError, match="no view shows"):
        away = [(CAMERA, look_at(CENTRE + np.array([0.3, 0, 0.2]), CENTRE + np.array([0.6, 0, 0.4])))]
        measure_edit(cloud, index, mesh, mesh, away)


def test_division_keeps_the_surface() -> None:
    mesh = ball()
    division = divide(mesh.faces, len(mesh.vertices), 2)
    fine = Mesh(division.weights @ mesh.vertices, division.faces)
    assert len(fine.faces) == 16 * len(mesh.faces)
    assert fine.areas().sum() == pytest.approx(mesh.areas().sum(), rel=1e-12)
    assert fine.volume() == pytest.approx(mesh.volume(), rel=1e-12)
    assert fine.is_watertight()
    np.testing.assert_array_equal(fine.vertices[: len(mesh.vertices)], mesh.vertices)
    np.testing.assert_allclose(division.weights.sum(1), 1.0, atol=1e-12)


def test_a_window_shows_what_the_photo_shows() -> None:
    mesh = ball()
    camera, pose = looks(5)[1]
    window, matrix = framed(camera, pose, mesh.vertices, 180, margin=0.1)
    pixels = window.project(mesh.vertices @ pose[:3, :3].T + pose[:3, 3])
    assert pixels.min() == pytest.approx(18, abs=1e-6)
    assert pixels.max() == pytest.approx(162, abs=1e-6)
    drawn = MeshComposition({"egg": mesh})
    photo = drawn.render(camera, pose, (1.0, 1.0, 1.0)).astype(np.float32) / 255
    cut, direct = window_of(photo, matrix, 180), drawn.render(window, pose, (1.0, 1.0, 1.0)).astype(np.float32) / 255
    inner = cv2.erode((drawn.coverage(window, pose) == 1).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    # Half a pixel of shift would cost ten times as much.
    assert np.abs(cut - direct)[inner].mean() < 0.004
    with pytest.raises(ValueError, match="before the camera"):
        framed(camera, look_at(CENTRE, CENTRE + np.array([1.0, 0, 0])), mesh.vertices, 180)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a small scene: the egg in nine photos, three of them held out, and splats of all bindings."""
    folder, mesh = tmp_path_factory.mktemp("scenes") / "egg", ball(3)
    drawn, views = MeshComposition({"egg": mesh}), []
    for index, (camera, pose) in enumerate(looks(9)):
        views.append(View(f"{index:04d}.png", camera, pose, "held_out" if index % 3 == 1 else "train"))
        write_image(folder / "sfm" / "images" / views[-1].name, drawn.render(camera, pose, (0.6, 0.6, 0.6)))
    write_views(folder / "align" / "views.json", views)
    for kind in COMPARED:
        write_binding(folder / "splats" / kind / "binding.npz", bound(kind, mesh, 1.25))
    return folder


def test_the_figure_and_its_record(scene: Path, tmp_path: Path) -> None:
    figure, record = tmp_path / "figures" / "edits.png", tmp_path / "figures" / "edits.json"
    write_editing(scene, figure, record, EditingSettings(azimuth_deg=45.0, size=96))
    image = read_image_u8(figure)
    assert image.shape[1] > 1500
    assert image.std() > 20
    content = read_json(record)
    assert content["status"] == "pass"
    assert (content["scene"], content["views"]) == ("egg", ["0001.png", "0004.png", "0007.png"])
    assert content["shown"][0] == "0001.png"
    assert set(content["edits"]) == {*COMPARED, CONTROL}
    soft, control = content["edits"]["soft"], content["edits"][CONTROL]
    assert soft[REST] == control[REST]
    for title in set(soft) - {REST}:
        assert soft[title]["holes"] < 0.002
        assert abs(soft[title]["psnr"] - soft[REST]["psnr"]) < 2
    worst = {name: min(found["psnr"] for found in content["edits"][name].values()) for name in ("soft", CONTROL)}
    assert worst[CONTROL] < worst["soft"] - 1


def test_splats_with_holes_are_degraded(scene: Path, tmp_path: Path) -> None:
    folder = tmp_path / "egg"
    for part in ("align", "sfm"):
        (folder / part).parent.mkdir(exist_ok=True)
        (folder / part).symlink_to(scene / part)
    mesh = ball(3)
    for kind in COMPARED:
        # Small discs leave gaps, which an edit opens further.
        write_binding(folder / "splats" / kind / "binding.npz", bound(kind, mesh, 0.6))
    write_editing(folder, tmp_path / "edits.png", tmp_path / "edits.json", EditingSettings(size=96))
    content = read_json(tmp_path / "edits.json")
    assert content["status"] == "degraded"
    assert any("silhouette" in reason for reason in content["reasons"])


def test_a_missing_binding_is_named(scene: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"binding\.npz"):
        write_editing(tmp_path / "none", tmp_path / "edits.png", tmp_path / "edits.json", EditingSettings())
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="no edit"):
        write_editing_figure([], {}, tmp_path / "edits.png")


def test_the_detail_lies_where_the_control_fails() -> None:
    names = {*WHOLE, *DETAIL}
    pictures = {name: np.ones((100, 100, 3), np.float32) for name in names}
    column = Column("rest", pictures, {})
    left, top, width, height = detail_window(column)
    assert abs(left + width / 2 - 50) <= 1
    assert abs(top + height / 2 - 50) <= 1
    spoilt = pictures[CONTROL].copy()
    spoilt[5:12, 80:90] = 0
    left, top, width, height = detail_window(Column("edit", {**pictures, CONTROL: spoilt}, {}))
    assert left <= 80
    assert left + width >= 90
    assert top <= 5
    assert top + height >= 12


def test_the_summary_takes_the_worst_edit() -> None:
    rest = EditQuality(0.0, 0.01, 0.0, 1.0, 32.0)
    bad = [EditQuality(0.001, 0.01, 0.0, 2.0, 31.0), EditQuality(0.0, 0.034, 0.0, 1.5, 31.5)]
    text = summary([rest, *bad])
    for line in ("holes 0.0 % → 0.1 %", "see-through 1.0 % → 3.4 %", "overhang 1.0 → 2.0 mm", "PSNR 32.0 → 31.0 dB"):
        assert line in text
    assert "reference" in summary([])
