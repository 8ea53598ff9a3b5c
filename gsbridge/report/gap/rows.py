"""Rows of the cases of the gap, `results/rows/gap.csv`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsbridge.files import read_json
from gsbridge.report.gap.text import explanation
from gsbridge.report.tables.rows import write_rows

COLUMNS = (
    "case", "verdict", "effects", "amended", "ambiguous", "something_remains", "p_value", "select_before", "select_after",
    "verify_before", "verify_after", "closure", "bank_simulations", "simulations", "seed", "status",
)  # fmt: skip
"""No column holds a time, so that the same seed gives the same table."""


def gap_row(case: str, findings: Mapping[str, Any]) -> dict[str, Any]:
    """Row of one case.

    Args:
        case: Name of the case.
        findings: `findings.json`.
    """
    checked = findings["verify"] or {}
    return {
        "case": case,
        "verdict": findings["verdict"],
        "effects": " + ".join(_full_name(item) for item in findings["effects"]),
        "amended": " + ".join(_full_name(item) for item in findings["amended"]),
        "ambiguous": " | ".join(explanation(names) for names in findings["ambiguous"]),
        "something_remains": findings["something_remains"],
        "p_value": float(findings["p_value"]),
        "select_before": float(findings["select"]["before"]),
        "select_after": float(findings["select"]["after"]),
        "verify_before": checked.get("before"),
        "verify_after": checked.get("after"),
        "closure": checked.get("closure"),
        "bank_simulations": findings["simulations"]["bank"],
        "simulations": findings["simulations"]["case"],
        "seed": findings["seed"],
        "status": findings["status"],
    }


def _full_name(item: Mapping[str, Any]) -> str:
    """Name of an effect with its joint."""
    return f"{item['name']}:{item['joint']}" if item.get("joint") else str(item["name"])


def write_gap_rows(findings: Mapping[str, str | Path], out: str | Path) -> None:
    """Write the rows of all cases.

    Args:
        findings: `findings.json` by case.
        out: The CSV.

    Raises:
        InputError: A file is missing or damaged.
    """
    write_rows(out, COLUMNS, [gap_row(case, read_json(path)) for case, path in findings.items()])
