"""Units of logged columns, and their conversion to SI."""

from __future__ import annotations

import math
import re
from pathlib import Path

from gsbridge.errors import InputError

FACTORS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180},
    "angular speed": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180, "rpm": math.pi / 30},
    "torque": {"N m": 1.0, "Nm": 1.0, "mNm": 1e-3, "A": math.nan, "mA": math.nan},
    "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "A": math.nan, "mA": math.nan},
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6},
    "speed": {"m/s": 1.0, "mm/s": 1e-3},
    "number": {"": 1.0, "1": 1.0},
}
"""Factor to SI of each unit, by dimension. Amperes become torque or force only with a gain, which the case has to state."""

CURRENTS = {"A": 1.0, "mA": 1e-3}
"""Units of current, and their factors to amperes."""

SLIDING = {"angle": "length", "angular speed": "speed", "torque": "force"}
"""Maps each dimension at a joint that turns to the corresponding one at a joint that slides."""

HEADER = "Write it into the header, or under 'units' of the case"
"""Advice on where to state the unit of a table's column."""

_HEADER = re.compile(r"^\s*(?P<name>[^\[\]]+?)\s*(?:\[(?P<unit>[^\]]*)\])?\s*$")


def split_header(header: str) -> tuple[str, str | None]:
    """Split a header `name [unit]` into name and unit; the unit is None if the header has none."""
    found = _HEADER.match(header)
    if not found:
        return header.strip(), None
    unit = found["unit"]
    return found["name"], None if unit is None else unit.strip()


def factor_to_si(
    unit: str | None, dimension: str, source: str | Path, column: str, gain: float | None = None, where: str = HEADER
) -> float:
    """Return the factor that converts a column to SI units.

    Args:
        unit: Unit as the file states it; None if it states none.
        dimension: A key of `FACTORS`.
        source: The file, for messages.
        column: The column, for messages.
        gain: N m or N per ampere, for efforts in amperes.
        where: Advice on where to state a missing unit, for messages.

    Raises:
        InputError: The unit is missing or unknown, or it is a current and there is no gain.
    """
    known = FACTORS[dimension]
    names = ", ".join(f"[{name}]" for name in known if name)
    if unit is None:
        if dimension == "number":
            return 1.0
        raise InputError(source, f"the column '{column}' has no unit", f"{where}, one of {names}")
    if unit not in known:
        raise InputError(source, f"the column '{column}' has the unit [{unit}], which is no {dimension}", f"Use {names}")
    if unit in CURRENTS:
        if gain is None:
            raise InputError(
                source,
                f"the effort '{column}' is in amperes and no gain is known",
                f"State 'torque_per_ampere' ({'N m' if dimension == 'torque' else 'N'}/A) in the case, or leave the column out",
            )
        return gain * CURRENTS[unit]
    return known[unit]
