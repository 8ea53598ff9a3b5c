"""Everything that the pages refer to exists: files, headings of other pages, modules and the names that they define."""

import ast
import re
import textwrap
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("benchmarks/*.md")])
FOLDERS = ["benchmarks", "docs", "envs", "gsbridge", "models", "profiles", "rules", "scripts", "tests", "workflow"]
SOURCE = re.compile(rf"`((?:{'|'.join(FOLDERS)})/[\w./-]*)`")
"""A file or folder of the project, as text names it; patterns such as `rules/*.smk` and commands are left aside."""
DEFINED = re.compile(r"`(gsbridge(?:\.\w+)+)`")
LINK = re.compile(r"\]\(([^()\s]+)\)")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
COMMANDS = ("board", "run", "run-policy", "status")
RULES = "".join(path.read_text(encoding="utf-8") for path in ROOT.glob("rules/*.smk"))


def prose(page):
    """A page without its code blocks, in which brackets mean something else."""
    return re.sub(r"^ *```.*?^ *```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


@cache
def anchors(page):
    """Names that a link can give to the headings of a page, as the hosting site forms them."""
    found = []
    for heading in re.findall(r"^#+ +(.*)$", prose(page), flags=re.MULTILINE):
        name = re.sub(r"[^\w\- ]", "", re.sub(r"\[(.*?)\]\(.*?\)", r"\1", heading).lower()).replace(" ", "-")
        found.append(f"{name}-{found.count(name)}" if name in found else name)
    return found


def test_headings_get_the_names_that_links_use(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A page: what's `in` it?\n\n```sh\n# no heading\n```\n## How many?\n### How many?\n")
    assert anchors(page) == ["a-page-whats-in-it", "how-many", "how-many-1"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for link in LINK.findall(prose(page)):
        if link.startswith(("http://", "https://", "mailto:")):
            continue
        file, _, anchor = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        assert target.exists(), f"{page.name}: {link}"
        assert target.is_relative_to(ROOT), f"{page.name}: {link} leaves the project"
        assert not anchor or anchor in anchors(target), f"{page.name}: {link} names no heading of {target.name}"


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=lambda page: page.name)
def test_files_and_modules_that_are_named_are_there(page):
    text = page.read_text(encoding="utf-8")
    for path in SOURCE.findall(text):
        # The path may also be a result: some pages name results without the folder `results/`.
        assert (ROOT / path).exists() or f'"results/{path}"' in RULES, f"{page.name} names {path}"
    for name in DEFINED.findall(text):
        assert is_defined(name), f"{page.name} names {name}"


BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
BLOCKS = [
    pytest.param(kind, textwrap.dedent(text), id=f"{page.name}-{number}-{kind}")
    for page in PAGES
    for number, (_, kind, text) in enumerate(BLOCK.findall(page.read_text(encoding="utf-8")))
]


@pytest.mark.parametrize(("kind", "text"), BLOCKS)
def test_blocks_of_code_are_what_they_say(kind, text):
    """Python, YAML and XML can be read; commands call targets of the Makefile, commands and profiles that there are."""
    if kind == "python":
        for node in ast.walk(ast.parse(text)) if not text.startswith("rule ") else ():
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gsbridge"):
                for alias in node.names:
                    assert is_defined(f"{node.module}.{alias.name}"), f"{node.module} has no {alias.name}"
    elif kind == "yaml":
        list(yaml.safe_load_all(text))
    elif kind == "sh":
        for target in re.findall(r"^make (?!PYTHON)([\w-]+)", text, re.MULTILINE):
            assert re.search(rf"^{target}:", MAKEFILE, re.MULTILINE), f"make has no target {target}"
        for command in re.findall(r"^(?:\.venv/bin/)?gsbridge ([a-z-]+)", text, re.MULTILINE):
            assert command in COMMANDS, f"gsbridge has no command {command}"
        for profile in re.findall(r"profile (profiles/\w+)", text):
            assert (ROOT / profile / "profile.yaml").is_file()
    elif kind == "xml":
        ElementTree.fromstring(text)
    else:
        assert kind == "csv", kind


def is_defined(name):
    """Whether a dotted name is a module of the library, or is defined at the top of one."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        base = ROOT.joinpath(*parts[:count])
        file = next((file for file in (base.with_suffix(".py"), base / "__init__.py") if file.is_file()), None)
        if file is not None:
            return count == len(parts) or parts[count] in top_names(file)
    return False


@cache
def top_names(file):
    """What a module defines or imports at its top."""
    found = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found.update(alias.asname or alias.name for alias in node.names)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found.update(target.id for target in targets if isinstance(target, ast.Name))
    return found
