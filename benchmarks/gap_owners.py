"""What an account of a real arm's gap says of its friction, beside what those who own the arm, or know it well, estimated."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gsbridge import logs
from gsbridge.errors import InputError
from gsbridge.files import write_json

Known = Mapping[tuple[str, str], float]
"""First parameter of an effect, SI units, by the effect's name and the joint's, as others estimated it."""


def compared(findings: Mapping[str, Any], known: Known) -> dict[str, Any]:
    """Set the sizes of friction in an account beside another estimate.

    Args:
        findings: Content of `findings.json`.
        known: The other estimate.
    """
    account = findings.get("account") or {"entries": [], "explained": 0.0}
    rows = [
        {
            "label": entry["label"],
            "share": entry["share"],
            "verdict": entry["verdict"],
            "parameters": {name: row["value"] for name, row in entry["parameters"].items()},
            "owners": known.get((entry["name"], entry["joint"])),
        }
        for entry in account["entries"]
    ]
    kept = {key: findings[key] for key in ("verdict", "sentence", "reasons", "simulations", "seconds")}
    return {**kept, "explained": account["explained"], "entries": rows}


def run(
    parser: argparse.ArgumentParser,
    arguments: Sequence[str] | None,
    write_case: Callable[[argparse.Namespace, Path], Path],
    known: Callable[[argparse.Namespace], Known],
) -> int:
    """Diagnose an arm, and print its account; the exit status is 2 if the data are missing.

    Args:
        parser: Parser of the options that name the data; `--output` is added.
        arguments: Command line; None for that of the process.
        write_case: Writes the case into a folder and returns its file.
        known: Returns the other estimate.
    """
    from gsbridge.gap.workflow import run_case

    parser.add_argument("--output", type=Path, help="JSON file of the figures")
    options = parser.parse_args(arguments)
    logs.start(1, None)
    with TemporaryDirectory(prefix="gsbridge-arm-") as place:
        folder = Path(place)
        try:
            case = write_case(options, folder)
            out = compared(run_case(case, folder / "out", folder / "bank"), known(options))
        except InputError as error:
            sys.stderr.write(f"{error}\n")
            return 2
    if options.output:
        write_json(options.output, out)
    sys.stdout.write(f"{out['verdict']}: {100 * out['explained']:.1f} % of the gap on 'verify' is explained.\n")
    for row in out["entries"]:
        beside = "" if row["owners"] is None else f"; owners: {row['owners']:.3g}"
        sizes = ", ".join(f"{name} {value:.3g}" for name, value in row["parameters"].items())
        sys.stdout.write(f"{row['label']}: {sizes} ({100 * row['share']:.1f} %{beside})\n")
    return 0
