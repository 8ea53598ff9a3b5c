"""Content of a rerun recording, read back from its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader


def read_recording(path: str | Path) -> dict[str, dict[str, Any]]:
    """Read back what a recording holds.

    Args:
        path: The `.rrd`.

    Returns:
        For each entity path: `rows` (logged rows), `timelines` (names), `static` (True if some of it is timeless), and
        `components` ({component: list of values of all rows, in the order of the file}).
    """
    chunks = RrdReader(str(path)).stream().to_chunks()
    out: dict[str, dict[str, Any]] = {}
    for chunk in chunks:
        found = out.setdefault(str(chunk.entity_path), {"rows": 0, "timelines": set(), "static": False, "components": {}})
        found["rows"] += chunk.num_rows
        found["timelines"] |= set(chunk.timeline_names)
        found["static"] |= chunk.is_static
        batch = chunk.to_record_batch()
        for field, column in zip(batch.schema, batch.columns, strict=True):
            kind = (field.metadata or {}).get(b"rerun:kind", b"")
            if kind not in (b"control", b"index"):
                found["components"].setdefault(field.name, []).extend(value for value in column if value.is_valid)
    return out
