"""Blocks of code of the pages, and the commands in them."""

import re
import shlex
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("benchmarks/*.md")])
BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
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
