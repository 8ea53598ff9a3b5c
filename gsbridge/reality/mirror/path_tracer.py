"""Mitsuba in the fastest variant that works on this machine, for the films.

`llvm_ad_rgb` traces a film's frame in about a quarter of the time that `scalar_rgb` takes and gives the same picture for the
same seed, whatever the number of threads; both agree within their noise. It needs libLLVM, which no wheel brings (Debian:
`libllvm19`), and crashes the process with some versions. A library is therefore tried in a process of its own before it is used
here; `scalar_rgb` needs nothing and serves where no library works.

What `llvm_ad_rgb` does before it traces, which is to go through scene and integrator and to look for a compiled kernel, takes
as long for a picture of 64 px as for a frame of a film, and there longer than tracing. `picture_maker` therefore records it
with the first picture and plays it back for those that follow.
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
"""Environment variable that names a variant; `fastest`, as without it, is the compiled one where it works."""

OLDEST_LLVM = 16
"""Version 15 crashes while it compiles the kernels of Mitsuba 3.9."""

_FOLDERS = ("/usr/lib/*-linux-gnu", "/usr/lib64", "/usr/lib/llvm-*/lib", "/usr/local/lib", "/opt/homebrew/opt/llvm/lib")
_NAMES = re.compile(r"libLLVM(?:-|\.so\.|\.)(\d+)[\d.]*(?:\.so[\d.]*|\.dylib)?$")
_TRIAL_S = 60.0

# A lit rectangle, small and cheap, with the plugins that the mirror uses; its mean is known: 0.5 / pi * pi * 2 = 1.
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
    """Copies of libLLVM on this machine that are new enough, the newest first."""
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
    """Whether Mitsuba renders with a library, tried in another process, which a crash does not take along."""
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
    """Whether the library works, remembered between processes for as long as library and Mitsuba stay what they are."""
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
        # Without a folder to remember it in, every process tries for itself.
        pass
    return answer


@functools.cache
def variant() -> str:
    """Name of the variant that this process uses; `DRJIT_LIBLLVM_PATH` is set where it needs a library.

    Raises:
        InputError: `GSBRIDGE_PATH_TRACER` names another variant, or one that does not work here.
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
    """Mitsuba in some variant, limited to `threads`.

    Args:
        threads: Threads to render with.
        wanted: Name of the variant; None for the fastest one that works, or what the environment asks for.

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
    """A picture whose pixels all hold a number: those without one take the median of their neighbours'.

    Rarely a path ends in no number, and a lens would spread it over 64 pixels of a photo.

    Args:
        picture: Linear light. [H, W, C].

    Returns:
        [H, W, C]; the same array where nothing has failed.
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
    """A function of a seed that gives the picture of a scene as it stands then, from where the sensor is then.

    Args:
        mi: Mitsuba, as `load_mitsuba` gave it.
        scene: The scene. What moves in it may be moved between calls, and nothing else may be changed.
        sensor: The sensor, likewise. Its size and samples are part of the record, so that every sensor has a maker of its own.
        integrator: Description of the integrator.

    Returns:
        Function that renders with as many samples as the sensor asks for. [H, W, C] float32.
    """
    light = mi.load_dict(dict(integrator))

    def trace(scene: Any, sensor: Any, seed: Any) -> Any:
        return mi.render(scene, sensor=sensor, integrator=light, seed=seed)

    if mi.variant() != COMPILED:
        return lambda seed: without_failed_pixels(np.array(trace(scene, sensor, seed)))
    import drjit

    recorded = drjit.freeze(trace)
    # As a number in the kernel's memory; one of Python's would be part of the record.
    return lambda seed: without_failed_pixels(np.array(recorded(scene, sensor, mi.UInt32(seed))))
