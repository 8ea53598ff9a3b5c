"""The kinds of measurement that records share, since residuals are compared column by column between them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.gap.formats.records import MEASURED, TOOL, Record


def without(record: Record, kind: str) -> Record:
    """Drop one kind of measurement from a record, with its quantum, noise and tolerance.

    Args:
        record: The record.
        kind: `position`, `velocity`, `effort` or `tool`.
    """
    parts = (record.measured, record.quantum, record.sigma, record.tolerance)
    kept = [{name: values for name, values in part.items() if name != kind} for part in parts]
    return replace(record, measured=kept[0], quantum=kept[1], sigma=kept[2], tolerance=kept[3])


def shared_kinds(
    records: Mapping[str, Record], unused: Collection[str], source: str | Path
) -> tuple[dict[str, Record], list[str]]:
    """Drop the kinds of measurement that some records lack; also return a warning about each of them, in words.

    Args:
        records: Records by role.
        unused: Kinds that nothing is compared with; they are kept.
        source: File of the case, for messages.

    Raises:
        InputError: Neither positions of the joints nor those of the tool are in all records.
    """
    out, reasons = dict(records), list[str]()
    for kind in (kind for kind in (*MEASURED, TOOL) if kind not in unused):
        lacking = [role for role, record in records.items() if kind not in record.measured]
        if 0 < len(lacking) < len(records):
            out = {role: without(record, kind) for role, record in out.items()}
            named = " and ".join(f"'{role}'" for role in lacking)
            reasons.append(f"the columns of '{kind}' are missing in the record {named}: they were left out of the others, too")
    if not all({"position", TOOL} & set(record.measured) for record in out.values()):
        raise InputError(
            source, "some records log the joints' positions and others the tool's, which cannot be compared",
            "Log the same columns in all records",
        )  # fmt: skip
    return out, reasons
