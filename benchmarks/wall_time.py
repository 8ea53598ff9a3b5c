"""Time a whole run, from nothing: `python benchmarks/wall_time.py make_toy --absent toy/results -- make toy`.

The time is kept only where the run succeeded and the folder named by `--absent` was not there before: what an earlier run left
would make it look fast. Other runs' times in the same file stay.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

from gsbridge.files import read_json, write_json

NAMES = ("make_tables", "make_toy")


def main() -> int:
    """Run the command; its exit status is this program's."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=NAMES, help="what is timed")
    parser.add_argument("--absent", type=Path, required=True, help="folder that the run makes and that must not be there yet")
    parser.add_argument("--output", type=Path, default=Path("results/benchmarks/wall_times.json"), help="file of times")
    parser.add_argument("command", nargs="+", help="what to run, behind --")
    arguments = parser.parse_args()
    if arguments.absent.exists():
        sys.exit(f"{arguments.absent} is there already: only a run from nothing is timed. Move it away")
    begin = time.monotonic()
    status = subprocess.run(arguments.command, check=False).returncode
    if status == 0:
        # Read after the run, which may have written to the folder itself.
        times = read_json(arguments.output) if arguments.output.is_file() else {}
        cores = len(os.sched_getaffinity(0))
        times[arguments.name] = {"wall_s": round(time.monotonic() - begin, 1), "cores": cores}
        write_json(arguments.output, times)
    return status


if __name__ == "__main__":
    sys.exit(main())
