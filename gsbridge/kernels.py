"""numba, with a cache folder that follows the kernels' source.

numba's own cache does not notice an edit in a module that a kernel imports, so the folder carries a digest of every module
that defines kernels: an edit starts a fresh folder. Import `njit` from here, never from numba.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeAlias, TypeVar, overload

from gsbridge.digests import kernel_digest
from gsbridge.notebook import cache_root


def cache_folder() -> Path:
    """Folder of the compiled kernels of this source tree."""
    return cache_root() / f"numba-{kernel_digest()}"


os.environ.setdefault("NUMBA_CACHE_DIR", str(cache_folder()))

import numba  # noqa: E402  (the cache folder is read when numba is imported)
import numpy as np  # noqa: E402
from numba import prange  # noqa: E402
from numba.extending import intrinsic as numba_intrinsic  # noqa: E402

options: Any = numba.config
"""numba's settings; of type Any, since numba creates their names at run time, where no type checker sees them."""
options.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]

Real: TypeAlias = float | np.floating[Any]
"""A number that a kernel takes or returns: Python's or numpy's."""

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Arguments = ParamSpec("_Arguments")


@overload
def njit(function: _Function) -> _Function: ...
@overload
def njit(**kwargs: Any) -> Callable[[_Function], _Function]: ...
def njit(*args: Any, **kwargs: Any) -> Any:
    """`numba.njit` with caching on; other options are numba's. For type checkers the compiled function keeps its type."""
    compiler = numba.njit(**{"cache": True, **kwargs})
    return compiler(*args) if args else compiler


def intrinsic(define: Callable[Concatenate[Any, _Arguments], Any]) -> Callable[_Arguments, Any]:
    """`numba.extending.intrinsic`. A kernel calls it without the first argument, numba's typing context."""
    made: Any = numba_intrinsic(define)
    return made


__all__ = ["Real", "cache_folder", "intrinsic", "njit", "options", "prange"]
