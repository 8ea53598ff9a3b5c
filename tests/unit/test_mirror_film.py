"""A whole small film: its photos against its truth, its record, its ceiling, and going on after a stop."""

from __future__ import annotations

import numpy as np
import pytest

from gsbridge.cameras import Camera, split_of
from gsbridge.configuration.films import FilmSettings
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.images import read_image_u8, read_mask
from gsbridge.meshes import read_mesh
from gsbridge.photogrammetry.board import find_tags, standard_board
from gsbridge.reality.mirror import film as film_module
from gsbridge.reality.mirror.film import DENSE, film_scene, image_motion
from gsbridge.reality.mirror.studio import Studio


def tiny(**values) -> FilmSettings:
    """Settings of a film with fewer frames than a user may ask for."""
    return FilmSettings().model_copy(update=values)


SETTINGS = tiny(frames=6, spp=4, held_out_spp=9, width=320, height=240)


def _film(scene, settings, root, seed=1):
    places = root / "frames", root / "film.json", root / "truth"
    film_scene(scene, settings, *places, state=root / "state", threads=1, seed=seed)
    return read_json(root / "film.json"), read_json(root / "truth" / "truth.json")


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    root = tmp_path_factory.mktemp("film")
    return root, *_film("small_cube", SETTINGS, root)


def test_record_lists_the_frames(film):
    root, record, truth = film
    assert record["status"] == "pass"
    assert record["kind"] == "object"
    assert [f["name"] for f in record["frames"]] == sorted(p.name for p in (root / "frames").iterdir())
    assert [f["name"] for f in record["frames"]] == [f["name"] for f in truth["frames"]]
    for k, frame in enumerate(record["frames"]):
        assert frame["spp"] == (9 if split_of(k) == "held_out" else 4)
        assert frame["time_s"] == pytest.approx(frame["index"] / record["fps"])


def test_tags_lie_where_the_truth_projects_them(film):
    root, _, truth = film
    camera = Camera.from_json(truth["camera"])
    board = standard_board(truth["board"]["sheet"])
    errors = []
    for frame in truth["frames"]:
        pose = np.array(frame["cam_from_table"])
        found = find_tags(read_image_u8(root / "frames" / frame["name"]), board)
        errors += [found[t] - camera.project(board.corners()[t] @ pose[:3, :3].T + pose[:3, 3]) for t in found]
    assert len(errors) >= 3  # few are large enough to be refined at this small size; a mirrored board would give none
    assert np.abs(np.concatenate(errors).mean(0)).max() < 0.1
    assert np.abs(np.concatenate(errors)).max() < 0.6


def test_masks_are_the_projection_of_the_true_mesh(film):
    root, _, truth = film
    camera = Camera.from_json(truth["camera"])
    mesh = read_mesh(root / "truth" / "mesh.ply")
    assert mesh.is_watertight()
    for frame in truth["frames"][::2]:
        pose = np.array(frame["cam_from_table"])
        mask = read_mask(root / "truth" / "masks" / frame["name"])
        pixels = camera.project(mesh.vertices @ pose[:3, :3].T + pose[:3, 3])
        rows, columns = np.nonzero(mask > 0.5)
        low, high = pixels.min(0), pixels.max(0)
        assert np.allclose([columns.min(), rows.min()], low, atol=1.5)
        assert np.allclose([columns.max() + 1, rows.max() + 1], high, atol=1.5)
        inside = np.floor(pixels).astype(int)
        assert (mask[inside[:, 1], inside[:, 0]] > 0).mean() > 0.99


def test_exposure_is_locked_and_unclipped(film):
    root, record, _ = film
    photos = np.stack([read_image_u8(root / "frames" / f["name"]) for f in record["frames"]])
    assert 0.3 < photos.mean() / 255 < 0.6
    assert (photos >= 254).mean() < 1e-3


def test_ceiling_rises_with_the_samples(film):
    _, record, _ = film
    assert set(record["ceiling_db"]) == {"4", "9"}
    assert 24 < record["ceiling_db"]["4"] < record["ceiling_db"]["9"] < 45
    assert set(record["ceiling_masked_db"]) == {"4", "9"}


def test_goes_on_after_a_stop_with_the_same_film(tmp_path, monkeypatch):
    rendered = []
    real = Studio.render

    def render(self, camera, pose, samples, seed):
        if len(rendered) == 2:
            raise KeyboardInterrupt
        rendered.append(seed)
        return real(self, camera, pose, samples, seed)

    settings = tiny(frames=3, spp=1, held_out_spp=1, width=64, height=64)
    monkeypatch.setattr(Studio, "render", render)
    with pytest.raises(KeyboardInterrupt):
        _film("foam_pad", settings, tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"state"}
    kept = (tmp_path / "state" / "frames" / "0000.png").read_bytes()
    first = list(rendered)
    rendered.clear()
    rendered.append("the two frames at hand are not counted again")
    monkeypatch.setattr(Studio, "render", lambda *a: (rendered.append(a[-1]), real(*a))[1])
    _film("foam_pad", settings, tmp_path)
    assert not set(first) & set(rendered)
    assert (tmp_path / "frames" / "0000.png").read_bytes() == kept


@pytest.mark.parametrize("seed", [2685, 2**32 - 1])
def test_every_seed_of_the_settings_makes_a_film(tmp_path, monkeypatch, seed):
    """The path tracer takes seeds of 32 bits."""
    rendered = []
    real = Studio.render
    monkeypatch.setattr(Studio, "render", lambda *a: (rendered.append(a[-1]), real(*a))[1])
    settings = tiny(frames=3, spp=1, held_out_spp=1, width=64, height=64)
    _film("foam_pad", settings, tmp_path, seed)
    assert len(set(rendered)) == len(rendered) == 4
    photos = [read_image_u8(path) for path in sorted((tmp_path / "frames").glob("*.png"))]
    assert len(photos) == 3
    assert all(photo.std() > 5 for photo in photos)


def test_dense_film_states_motion_and_blur(tmp_path):
    settings = tiny(frames=14, spp=1, held_out_spp=1, width=96, height=72)
    record, truth = _film(DENSE, settings, tmp_path)
    assert record["kind"] == "dense"
    motion = np.array([f["motion_px"] for f in truth["frames"]])
    blur = np.array([f["blur_px"] for f in truth["frames"]])
    shaken = np.array([f["blurred"] for f in truth["frames"]])
    assert (motion[:3] == 0).all()
    assert (motion[4:] > 0.05).all()
    assert shaken.any()
    assert (blur[shaken] > 0.5).all()
    assert (blur[~shaken] == 0).all()


def test_image_motion_of_a_turn_about_the_line_of_sight():
    camera = Camera(200, 200, 100.0, 100.0, 100.0, 100.0)
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    down[:3, 3] = [0, 0.1, 1.0]
    shifted = down.copy()
    shifted[0, 3] += 0.01
    assert image_motion(camera, down, shifted) == pytest.approx(1.0, rel=1e-6)  # 10 mm at 1 m and 100 px


def test_bad_settings_and_scenes_are_refused(tmp_path):
    with pytest.raises(InputError, match="frames: 1 is less than the minimum of 8"):
        _film("small_cube", FilmSettings(frames=1), tmp_path)
    with pytest.raises(InputError, match="unknown"):
        _film("teapot", SETTINGS, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_public_name_of_the_dense_film():
    assert film_module.DENSE in film_module.SCENES
