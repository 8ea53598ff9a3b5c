"""Blocks of code on the documentation's pages, and the commands in them."""

import re
import shlex
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("benchmarks/*.md")])
BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
NOT_RUN = {
    ".": "it switches to the environment that the tests run in",
    "pip": "it fetches packages",
    "python -m venv": "it fetches packages",
    "python -c import lpips, torch;": "it needs weights that are not ours to pass on",
    "make": "it sets up an environment or takes up to hours; make names what it would do",
    "python benchmarks/": "it takes minutes to hours; the program is asked which options it knows",
    "gsbridge run-policy": "it wants an arm or a trained policy; test_cli_run_policy runs it with small ones",
    "snakemake --report": "it wants finished results; tests/e2e makes a report of them",
    "snakemake --workflow-profile profiles/s3": "it wants a store of objects; tests/rules/test_storage runs one",
    "snakemake --workflow-profile profiles/kubernetes": "it wants a cluster; tests/rules/test_kubernetes has a stand-in",
}
"""Commands of the pages that no test runs as they stand, by how they begin, and why; snakemake plans all others."""

_VARIABLE = re.compile(r"^[A-Z_]+=\S+$")


def blocks(page, kind):
    """Blocks of one kind. List of texts.

    Args:
        page: The file.
        kind: Such as `python`.
    """
    found = BLOCK.findall(Path(page).read_text(encoding="utf-8"))
    return [textwrap.dedent(text) for _, name, text in found if name == kind]


def commands(page):
    """Commands of a page's shell blocks: lists of words, variables for one command left out, `$P` as it was set."""
    out = []
    for block in blocks(page, "sh"):
        known = {}
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line.replace("…", "name=value"), comments=True)
            if len(words) == 1 and _VARIABLE.match(words[0]):
                name, value = words[0].split("=", 1)
                known[f"${name}"] = value
                continue
            while words and _VARIABLE.match(words[0]):
                words = words[1:]
            if words:
                out.append([known.get(word, word) for word in words])
    return out


def program(words):
    """The program that a command calls, wherever its environment lies."""
    return words[0].removeprefix(".venv/bin/").removeprefix("lpips-env/bin/")


def not_run(words):
    """The beginning in `NOT_RUN` that a command has; None where it has none of them."""
    text = " ".join([program(words), *words[1:]])
    return next((start for start in NOT_RUN if text == start or text.startswith(start + " " * (not start.endswith("/")))), None)
