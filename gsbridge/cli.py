"""Command line: what is done by hand, outside the workflow."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gsbridge import __version__
from gsbridge.board import SHEETS_M, standard_board, write_board
from gsbridge.capture.printing import write_sheet
from gsbridge.errors import GsbridgeError


def main(arguments: list[str] | None = None) -> int:
    """Run `gsbridge`; returns the exit code."""
    parser = argparse.ArgumentParser(prog="gsbridge", description="Tools beside the Snakemake workflow.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True)
    board = commands.add_parser("board", help="write the printable board for scale and registration")
    board.add_argument("path", type=Path, help="file to write: .pdf or .svg")
    board.add_argument("--sheet", choices=sorted(SHEETS_M), default="a4", help="paper size (default: a4)")
    board.add_argument("--layout", type=Path, help="also write the layout of the tags as JSON")
    options = parser.parse_args(arguments)
    try:
        layout = standard_board(options.sheet)
        write_sheet(layout, options.path)
        if options.layout:
            write_board(options.layout, layout)
    except (GsbridgeError, OSError) as error:
        print(f"gsbridge: {error}", file=sys.stderr)
        return 1
    print(f"{options.path}: print it at 100 % on {options.sheet.upper()} and check the ruler on it")
    return 0


if __name__ == "__main__":
    sys.exit(main())
