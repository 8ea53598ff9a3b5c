"""The choice of Mitsuba's variant, and that both variants give the same picture within their noise."""

import os
import subprocess
import sys

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.reality.mirror import path_tracer

RENDER = """
import sys
import numpy as np
from gsbridge.cameras import Camera
from gsbridge.reality.mirror import studio as module
# A table without pattern: painting the true one takes longer than all renderings.
module.table_texture = lambda background, seed: np.full((10, 12, 3), 0.25, np.float32)
studio = module.build_studio("small_cube", "a4", int(sys.argv[2]), 0)
pose = np.array([[1, 0, 0, 0], [0, -1, 0, 0.15], [0, 0, -1, 0.5], [0, 0, 0, 1.0]])
camera = Camera(48, 36, 45.0, 45.0, 24.0, 18.0)
pictures = [studio.render(camera, pose, 64, seed) for seed in (1, 2, 3)]
np.savez(sys.argv[1], pictures=pictures, cover=studio.coverage(camera, pose))
"""


def rendered(tmp_path, variant, threads=1):
    """Pictures of one scene by three seeds, in a process that uses a variant. [3, 36, 48, 3], and the object's coverage."""
    out = tmp_path / f"{variant}-{threads}.npz"
    environment = {**os.environ, path_tracer.CHOICE: variant}
    subprocess.run([sys.executable, "-c", RENDER, str(out), str(threads)], env=environment, check=True)
    with np.load(out) as data:
        return data["pictures"], data["cover"]


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    """Nothing remembered, nothing named."""
    monkeypatch.setenv(path_tracer.CHOICE, path_tracer.FASTEST)
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path_tracer.variant.cache_clear()
    yield
    path_tracer.variant.cache_clear()


def library(folder, source):
    """A shared library made of a line of C."""
    path = folder / "libLLVM.so.19.1"
    subprocess.run(["cc", "-shared", "-fPIC", "-x", "c", "-", "-o", str(path)], input=source, text=True, check=True)
    return path


@pytest.mark.parametrize(
    "source",
    ["int nothing;", "#include <stdlib.h>\n__attribute__((constructor)) static void end(void) { abort(); }"],
    ids=["is no LLVM", "crashes the process"],
)
def test_a_library_that_does_not_work_is_left_alone(fresh, monkeypatch, tmp_path, source):
    monkeypatch.setattr(path_tracer, "_FOLDERS", (str(tmp_path),))
    path = library(tmp_path, source)
    assert path_tracer.llvm_libraries() == [path]
    assert path_tracer.variant() == path_tracer.SCALAR
    # The answer is remembered: another process need not try again.
    path_tracer.variant.cache_clear()
    monkeypatch.setattr(path_tracer, "_works", lambda _: pytest.fail("tried again"))
    assert path_tracer.variant() == path_tracer.SCALAR


def test_a_library_that_is_asked_for_and_missing_is_an_error(fresh, monkeypatch, tmp_path):
    monkeypatch.setattr(path_tracer, "_FOLDERS", (str(tmp_path),))
    monkeypatch.setenv(path_tracer.CHOICE, path_tracer.COMPILED)
    with pytest.raises(InputError, match="no libLLVM works here"):
        path_tracer.variant()
    monkeypatch.setenv(path_tracer.CHOICE, "cuda")
    with pytest.raises(InputError, match="'cuda' is no variant"):
        path_tracer.variant()


@pytest.mark.parametrize(("works", "chosen"), [(True, path_tracer.COMPILED), (False, path_tracer.SCALAR)])
def test_films_are_compiled_where_a_library_works_unless_another_variant_is_asked_for(
    fresh, monkeypatch, tmp_path, works, chosen
):
    monkeypatch.delenv(path_tracer.CHOICE)
    monkeypatch.setattr(path_tracer, "_FOLDERS", (str(tmp_path),))
    monkeypatch.setattr(path_tracer, "_works", lambda _: works)
    (tmp_path / "libLLVM.so.19.1").write_bytes(b"")
    assert path_tracer.variant() == chosen
    path_tracer.variant.cache_clear()
    monkeypatch.setenv(path_tracer.CHOICE, path_tracer.SCALAR)
    assert path_tracer.variant() == path_tracer.SCALAR


def test_new_libraries_come_first_and_old_ones_never(fresh, monkeypatch, tmp_path):
    for name in (
        "libLLVM-14.so.1",
        "libLLVM-15.so",
        "libLLVM-16.so.1",
        "libLLVM.so.19.1",
        "libLLVM-17.so",
        "libLLVM-C.so",
        "x.so",
    ):
        (tmp_path / name).write_bytes(b"")
    monkeypatch.setattr(path_tracer, "_FOLDERS", (str(tmp_path),))
    names = [path.name for path in path_tracer.llvm_libraries()]
    assert names == ["libLLVM.so.19.1", "libLLVM-17.so", "libLLVM-16.so.1"]


def test_both_variants_agree_within_their_noise_whatever_the_threads(fresh, tmp_path):
    if path_tracer.variant() != path_tracer.COMPILED:
        pytest.skip("no working libLLVM on this machine")
    scalar, scalar_cover = rendered(tmp_path, path_tracer.SCALAR)
    compiled, compiled_cover = rendered(tmp_path, path_tracer.COMPILED)
    # The spread between seeds is the noise of each; pixels of an edge are as likely to differ up as down.
    noise = np.sqrt((scalar.var(0, ddof=1).mean() + compiled.var(0, ddof=1).mean()) / 3)
    difference = scalar.mean(0) - compiled.mean(0)
    assert np.sqrt((difference**2).mean()) < 1.25 * noise
    assert abs(difference.mean()) < 4 * noise / np.sqrt(difference.size)
    assert abs(scalar_cover - compiled_cover).mean() < 0.01
    again, _ = rendered(tmp_path, path_tracer.COMPILED, threads=2)
    np.testing.assert_array_equal(compiled, again)


def test_pixels_without_a_number_take_their_neighbours():
    rng = np.random.default_rng(1)
    picture = rng.uniform(0.2, 0.3, (6, 7, 3)).astype(np.float32)
    assert path_tracer.without_failed_pixels(picture) is picture
    broken = picture.copy()
    broken[0, 0, 1], broken[3, 4], broken[3, 5] = np.nan, np.inf, np.nan
    whole = path_tracer.without_failed_pixels(broken)
    assert ((whole > 0.2) & (whole < 0.3)).all()
    changed = (whole != picture).any(axis=-1)
    assert {tuple(place) for place in np.argwhere(changed)} == {(0, 0), (3, 4), (3, 5)}
    assert (path_tracer.without_failed_pixels(np.full((2, 2, 3), np.nan)) == 0).all()
