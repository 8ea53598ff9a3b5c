"""Reading of learning curves (`training.csv`)."""

from __future__ import annotations

import csv
from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.policy.curve import COLUMNS, Row


def read_curve(path: str | Path) -> list[Row]:
    """Rows of a learning curve; None where a figure is unknown.

    Raises:
        InputError: The file is missing, damaged or empty.
    """
    try:
        with open(path, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            if tuple(reader.fieldnames or ()) != COLUMNS:
                raise ValueError("its columns are not those of a learning curve")
            rows = [{name: float(value) if value else None for name, value in row.items()} for row in reader]
    except (OSError, TypeError, ValueError) as error:
        raise InputError(path, f"the learning curve cannot be read ({error})", "Train the policy again") from error
    if not rows:
        raise InputError(path, "the learning curve has no rows", "Train the policy again")
    return rows
