"""Lenses of photos by their EXIF data, against COLMAP's own reading where it can decode them."""

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from gsbridge.capture.lenses import Lens, _written, lenses_of
from gsbridge.photogrammetry.colmap import exif_focal_px

FOCAL_MM, ZOOM, FILM, NAME = 0x920A, 0xA404, 0xA405, 0xA434


def photo(path: Path, **tags: object) -> Path:
    """A photo of 400 x 300 px with some EXIF data."""
    exif = PIL.Image.Exif()
    names = {"focal_mm": FOCAL_MM, "zoom": ZOOM, "film": FILM, "name": NAME}
    for name, value in tags.items():
        exif.get_ifd(0x8769)[names[name]] = value
    PIL.Image.fromarray(np.zeros((300, 400, 3), np.uint8)).save(path, exif=exif.tobytes())
    return path


def test_focal_lengths_are_those_that_colmap_reads(tmp_path):
    paths = [photo(tmp_path / f"{film}.jpg", film=film) for film in (24, 26, 52)]
    found = lenses_of(paths, [1.0, 0.5, 1.0])
    assert [lens.number for lens in found] == [0, 1, 2]
    read = [exif_focal_px(path) for path in paths]
    assert [lens.focal for lens in found] == [pytest.approx(read[0]), pytest.approx(0.5 * read[1]), pytest.approx(read[2])]


@pytest.mark.parametrize("ending", ["jpg", "png", "tiff"])
def test_what_colmap_cannot_decode_has_the_focal_length_that_it_would_read(tmp_path, monkeypatch, ending):
    """COLMAP decodes no HEIC, and nothing here writes one: it reads these, and then is made to say nothing."""
    path = photo(tmp_path / f"a.{ending}", film=26)
    read = exif_focal_px(path)
    monkeypatch.setattr("gsbridge.photogrammetry.colmap.exif_focal_px", lambda path: None)
    assert lenses_of([path], [1.0]) == [Lens(0, pytest.approx(read, rel=1e-3))]


def test_a_heic_is_opened():
    marks, _, _ = _written(Path(__file__).parents[1] / "fuzz/data/turned.heic")
    assert marks is not None


def test_a_cropped_lens_that_states_the_same_pixels_is_another(tmp_path):
    paths = [
        photo(tmp_path / "main.jpg", film=26, focal_mm=5.7, name="back 5.7mm"),
        photo(tmp_path / "macro.jpg", film=26, focal_mm=1.57, name="back 1.57mm"),
        photo(tmp_path / "zoomed.jpg", film=26, focal_mm=5.7, name="back 5.7mm", zoom=2.0),
        photo(tmp_path / "again.jpg", film=26, focal_mm=5.7, name="back 5.7mm"),
    ]
    assert [lens.number for lens in lenses_of(paths, [1.0] * 4)] == [0, 1, 2, 0]


def test_photos_without_exif_share_a_camera_and_rounding_makes_no_lens(tmp_path):
    plain = [photo(tmp_path / f"{number}.jpg") for number in range(2)]
    assert lenses_of(plain, [1.0, 1.0]) == [Lens(0, None)] * 2
    rounded = [photo(tmp_path / f"r{film}.jpg", film=film) for film in (100, 101)]
    assert {lens.number for lens in lenses_of(rounded, [1.0, 1.0])} == {0}
