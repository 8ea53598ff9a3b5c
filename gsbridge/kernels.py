"""numba, with a cache folder that follows the kernels' source.

numba's own cache does not notice an edit in a module that a kernel imports, so the folder carries a digest of every module
that defines kernels: an edit starts a fresh folder. Import `njit` from here, never from numba.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from gsbridge.digests import kernel_digest


def cache_folder() -> Path:
    """Folder of the compiled kernels of this source tree."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "gsbridge" / f"numba-{kernel_digest()}"


os.environ.setdefault("NUMBA_CACHE_DIR", str(cache_folder()))

import numba  # noqa: E402  (the cache folder is read when numba is imported)
from numba import prange  # noqa: E402

numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]


def njit(*args: Any, **options: Any) -> Any:
    """`numba.njit` with caching on; the other options as in numba."""
    options = {"cache": True, **options}
    return numba.njit(**options) if not args else numba.njit(**options)(*args)


__all__ = ["cache_folder", "njit", "prange"]
