"""Errors that the user can mend, told in one line before any job starts, without snakemake's traceback."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from gsbridge.errors import GsbridgeError


@contextlib.contextmanager
def told() -> Iterator[None]:
    """End the run with one line if something that the user gave cannot be used. Serves as a `with` block or as a decorator.

    Raises:
        SystemExit: A `GsbridgeError` was raised inside. Snakemake lets `SystemExit` pass; others it prints with a traceback.
    """
    try:
        yield
    except GsbridgeError as error:
        raise SystemExit(f"ERROR {error}") from None
