"""Snakemake forked from a process that has already imported its modules: imports take two thirds of a dry run's time.

Every call is still a process of its own, with its own folder, environment and output. The process that it is forked from has
only done the imports.
"""

import contextlib
import importlib
import json
import os
import re
import subprocess
import sys
import traceback
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def imported_by_the_workflow() -> list[str]:
    """Modules of the library that the Snakefile and its rules import."""
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "Snakefile", *sorted((ROOT / "rules").glob("*.smk")))]
    return sorted({name for text in texts for name in re.findall(r"^from (gsbridge[\w.]*) import", text, re.MULTILINE)})


class PreparedSnakemake:
    """Starts the process that forks, and asks it for runs, one after the other."""

    def __init__(self) -> None:
        # Run in the project's root, so that modules are found as by `python -m snakemake` there.
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.rules.prepared"], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def run(self, arguments: tuple[str, ...], environment: dict[str, str], folder: Path) -> subprocess.CompletedProcess[str]:
        """One call of snakemake in the project's root.

        Args:
            arguments: What follows `snakemake`.
            environment: All variables of the call.
            folder: For its output.
        """
        files = [folder / name for name in ("stdout", "stderr")]
        request = {"arguments": arguments, "environment": environment, "files": [str(file) for file in files]}
        assert self.process.stdin
        assert self.process.stdout
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        code = int(self.process.stdout.readline())
        return subprocess.CompletedProcess(list(arguments), code, *(file.read_text() for file in files))

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin
        self.process.stdin.close()
        self.process.wait(timeout=60)


def _run(request: dict) -> None:
    """In the fork: what `python -m snakemake` does."""
    from snakemake.cli import main

    for number, name in enumerate(request["files"], start=1):
        file = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, number)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.argv = ["snakemake", *request["arguments"]]
    code = 1
    try:
        main(request["arguments"])
        code = 0
    except SystemExit as stop:
        if isinstance(stop.code, str):
            # Python itself prints the text of a SystemExit like this when a program ends.
            sys.stderr.write(f"{stop.code}\n")
        code = stop.code if isinstance(stop.code, int) else int(bool(stop.code))
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def serve() -> None:
    """Import, then fork for every line that is asked."""
    importlib.import_module("snakemake.cli")
    for name in imported_by_the_workflow():
        importlib.import_module(name)
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            _run(json.loads(line))
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        sys.stdout.write(f"{code}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    serve()
