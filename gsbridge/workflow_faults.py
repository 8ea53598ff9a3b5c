"""What the user can mend, told in one line before any job starts: snakemake would show its own way to it, too."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from gsbridge.errors import GsbridgeError


@contextlib.contextmanager
def told() -> Iterator[None]:
    """End the run with one line where something that the user gave cannot be used; a block, or the decorator of a function.

    Raises:
        SystemExit: Such an error was raised inside. Snakemake lets this one pass; all others it prints with a traceback.
    """
    try:
        yield
    except GsbridgeError as error:
        raise SystemExit(f"ERROR {error}") from None
