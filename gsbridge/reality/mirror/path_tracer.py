"""Mitsuba in the fastest variant that works on this machine.

`llvm_ad_rgb` renders a film's frame in about a quarter of the time of `scalar_rgb`. For one seed it gives the same picture with
any number of threads, and its pictures agree with those of `scalar_rgb` within the noise. It needs libLLVM, which no wheel
contains (Debian: `libllvm19`); some versions of it crash the process. A library is therefore tried in a separate process before
it is used here. `scalar_rgb` needs no library and is used where none works.

Before it traces a picture, `llvm_ad_rgb` goes through scene and integrator and looks for a compiled kernel. This takes as long
for a picture of 64 px as for a frame of a film, and for the small picture longer than the tracing. `picture_maker` therefore
records these steps with the first picture and replays them for the following ones.
"""

from __future__ import annotations

import functools
import glob
import json
import logging
import os
import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array

SCALAR, COMPILED, FASTEST = "scalar_rgb", "llvm_ad_rgb", "fastest"

CHOICE = "GSBRIDGE_PATH_TRACER"
"""Environment variable that names a variant. `fastest`, the default, is the compiled variant where it works."""

OLDEST_LLVM = 16
"""Oldest usable version: version 15 crashes while it compiles the kernels of Mitsuba 3.9."""

_FOLDERS = ("/usr/lib/*-linux-gnu", "/usr/lib64", "/usr/lib/llvm-*/lib", "/usr/local/lib", "/opt/homebrew/opt/llvm/lib")
_NAMES = re.compile(r"libLLVM(?:-|\.so\.|\.)(\d+)[\d.]*(?:\.so[\d.]*|\.dylib)?$")
_TRIAL_S = 60.0

# The trial renders a small lit rectangle with plugins that the mirror uses. The mean is known: 0.5 / pi * pi * 2 = 1.
_TRIAL = """
import sys, drjit, mitsuba
mitsuba.set_variant(sys.argv[1])
drjit.set_thread_count(1)
scene = mitsuba.load_dict({
    "type": "scene", "integrator": {"type": "path", "max_depth": 3},
    "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 2.0}},
    "wall": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}},
    "sensor": {"type": "perspective", "fov": 20.0,
               "to_world": mitsuba.ScalarTransform4f().look_at(origin=[0, 0, 3], target=[0, 0, 0], up=[0, 1, 0]),
               "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}}}})
import numpy
mean = float(numpy.array(mitsuba.render(scene, spp=64, seed=1)).mean())
sys.exit(0 if abs(mean - 1.0) < 0.02 else 1)
"""


def llvm_libraries() -> list[Path]:
    """Return the copies of libLLVM on this machine that are new enough, the newest first."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if named:
        return [Path(named)]
    found: dict[Path, int] = {}
    for folder in _FOLDERS:
        for path in glob.glob(f"{folder}/libLLVM*"):
            match = _NAMES.search(Path(path).name)
            if match and int(match[1]) >= OLDEST_LLVM:
                found.setdefault(Path(path).resolve(), int(match[1]))
    return sorted(found, key=lambda path: (-found[path], str(path)))


def _works(library: Path) -> bool:
    """Whether Mitsuba renders with a library; it is tried in another process, so that a crash does not end this one."""
    environment = {**os.environ, "DRJIT_LIBLLVM_PATH": str(library)}
    try:
        tried = subprocess.run(
            [sys.executable, "-c", _TRIAL, COMPILED], env=environment, capture_output=True, timeout=_TRIAL_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return tried.returncode == 0


def _cache_file() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "gsbridge" / "llvm.json"


def _known_to_work(library: Path) -> bool:
    """Whether the library works; the answer is stored on disk and used until the library or Mitsuba changes."""
    from importlib.metadata import version

    state = library.stat()
    key = f"{library} {state.st_size} {state.st_mtime_ns} mitsuba {version('mitsuba')} drjit {version('drjit')}"
    path = _cache_file()
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        known = {}
    if isinstance(known, dict) and isinstance(known.get(key), bool):
        return known[key]
    answer = _works(library)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}.part")
        part.write_text(json.dumps({key: answer}), encoding="utf-8")
        part.replace(path)
    except OSError:
        # If the answer cannot be stored, every process tries the library itself.
        pass
    return answer


@functools.cache
def variant() -> str:
    """Return the variant that this process uses; sets `DRJIT_LIBLLVM_PATH` if the variant needs a library.

    Raises:
        InputError: `GSBRIDGE_PATH_TRACER` names an unknown variant, or one that does not work here.
    """
    wanted = os.environ.get(CHOICE, "")
    if wanted not in ("", SCALAR, COMPILED, FASTEST):
        raise InputError(CHOICE, f"'{wanted}' is no variant", f"Use {SCALAR}, {COMPILED} or {FASTEST}, or leave it out")
    if wanted == SCALAR:
        return SCALAR
    for library in llvm_libraries():
        if library.exists() and _known_to_work(library):
            os.environ["DRJIT_LIBLLVM_PATH"] = str(library)
            return COMPILED
    if wanted == COMPILED:
        raise InputError(CHOICE, "no libLLVM works here", f"Install libllvm19, or use {SCALAR}")
    logging.getLogger("gsbridge").info("No working libLLVM: paths are traced by %s, which takes four times as long", SCALAR)
    return SCALAR


def load_mitsuba(threads: int, wanted: str | None = None) -> Any:
    """Load Mitsuba in a variant, limited to `threads`.

    Args:
        threads: Threads to render with.
        wanted: Name of the variant; None for the one that `variant` chooses.

    Raises:
        InputError: See `variant`.
    """
    chosen = wanted or variant()  # before drjit is imported, which looks for its library once
    import drjit
    import mitsuba

    mitsuba.set_variant(chosen)
    # Warnings only say that the sampler rounds a number of samples up.
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    drjit.set_thread_count(threads)
    return mitsuba


def without_failed_pixels(picture: Array) -> Array:
    """Replace pixels that are not finite by the median of their neighbours.

    Rarely a path gives NaN or infinity, and the interpolation of the lens would spread it over 64 pixels of a photo.

    Args:
        picture: Linear light. [H, W, C].

    Returns:
        The picture; the same array if all its pixels are finite. [H, W, C].
    """
    failed: Array = np.asarray(~np.isfinite(picture).all(axis=-1))
    if not failed.any():
        return picture
    whole = picture.copy()
    for row, column in np.argwhere(failed):
        part = np.s_[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
        near = picture[part][~failed[part]]
        whole[row, column] = np.median(near, axis=0) if len(near) else 0.0
    return whole


def picture_maker(mi: Any, scene: Any, sensor: Any, integrator: Mapping[str, Any]) -> Callable[[int], Array]:
    """Return a function of a seed that renders the scene as it is at the time of the call, from the sensor's pose at that time.

    Args:
        mi: Mitsuba, as `load_mitsuba` returned it.
        scene: The scene. Between calls, transforms may change and nothing else.
        sensor: The sensor. Between calls, its transform may change and nothing else: its size and number of samples are part of
            the recording, so every sensor needs its own function.
        integrator: Description of the integrator.

    Returns:
        Function that renders with the sensor's number of samples. [H, W, C] float32.
    """
    light = mi.load_dict(dict(integrator))

    def trace(scene: Any, sensor: Any, seed: Any) -> Any:
        return mi.render(scene, sensor=sensor, integrator=light, seed=seed)

    if mi.variant() != COMPILED:
        return lambda seed: without_failed_pixels(np.array(trace(scene, sensor, seed)))
    import drjit

    recorded = drjit.freeze(trace)
    # Pass the seed as a number in the kernel's memory: a Python number would become a constant of the recording.
    return lambda seed: without_failed_pixels(np.array(recorded(scene, sensor, mi.UInt32(seed))))
