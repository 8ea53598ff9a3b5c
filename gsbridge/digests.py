"""Digests of code, so that an edit reruns exactly the jobs whose script reaches it.

Snakemake watches the date of a rule's script only, and dates change with every clone. Each rule therefore carries, as a
parameter, a digest over its script and all modules that the script imports, directly or not. Comments, docstrings and
formatting do not count, nor do the modules of `WITHOUT_EFFECT`; the text of a message inside any other module does. Files
beside the code, such as templates, belong to the package in whose folder they lie.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import os
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from gsbridge.notebook import Notebook, cache_root

PACKAGE = Path(__file__).resolve().parent
NAME = PACKAGE.name
FOLLOWED = (NAME, "scripts", "benchmarks")
"""Folders of the checkout whose modules are followed: the library, the rules' scripts, and the programs that rules run."""

WITHOUT_EFFECT = frozenset(
    {NAME, f"{NAME}.logs", f"{NAME}.errors", f"{NAME}.digests", f"{NAME}.notebook", f"{NAME}.configuration.faults"}
)
"""Modules that cannot change a stage's result."""

_NAMED = re.compile(rf"""["']({NAME}(?:\.\w+)+)["':]""")
"""A module that is named in a string, as `importlib.import_module` and `importlib.resources.files` take it."""


@functools.cache
def module_file(module: str) -> Path | None:
    """File of a module of the checkout, or None if there is no such module."""
    base = PACKAGE.parent.joinpath(*module.split("."))
    for candidate in (base.with_suffix(".py"), base / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """The module and its statements at any depth. Expressions, which are nearly all nodes of a tree, are skipped."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            waiting.extend(getattr(node, block, ()))


@functools.cache
def _notebook() -> Notebook:
    """Facts that earlier processes read, kept apart by Python version (syntax trees differ) and by the text of this module."""
    edition = hashlib.sha256(Path(__file__).read_bytes() + repr(sys.version_info[:2]).encode()).hexdigest()[:12]
    return Notebook(cache_root() / f"digests-{edition}.json")


class _Facts(NamedTuple):
    """Facts about a module's text that the digests need."""

    code: str
    """Digest of the module's code without comments, docstrings and formatting, in hexadecimal digits."""
    imports: list[str]
    """Names that the module may import. Which of them are modules depends on the checkout and is found out later."""
    relative: bool
    """Whether the module uses a relative import, which this reader does not follow."""


@functools.cache
def _facts(module: str) -> _Facts:
    """Facts of a module. Its text is parsed only if no earlier process has read the same text."""
    path = module_file(module)
    if path is None:
        raise ValueError(f"there is no module {module}")
    text = path.read_bytes()
    facts = _notebook().look_up(hashlib.sha256(text).hexdigest(), lambda: list(_read(text.decode("utf-8"))))
    return _Facts(*facts)


def _read(text: str) -> _Facts:
    """Facts of a module's text, read from its syntax tree."""
    tree = _tree(text)
    found, relative = set(_NAMED.findall(text)), False
    for node in _statements(tree):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names if alias.name.split(".")[0] in FOLLOWED)
        elif isinstance(node, ast.ImportFrom):
            relative = relative or bool(node.level)
            if node.module and node.module.split(".")[0] in FOLLOWED:
                found.update([node.module, *(f"{node.module}.{alias.name}" for alias in node.names)])
    return _Facts(hashlib.sha256(_dumped(tree).encode()).hexdigest(), sorted(found), relative)


def _tree(text: str) -> ast.Module:
    """Syntax tree of a module without its docstrings; those below constants and settings are left out, too."""
    tree = ast.parse(text)
    for node in _statements(tree):
        body = getattr(node, "body", None)
        if body:
            # An empty body would not be valid syntax; the digest only needs it to be constant.
            node.body = [item for item in body if not _is_text(item)] or [ast.Pass()]  # type: ignore[attr-defined]
    return tree


def _dumped(tree: ast.Module) -> str:
    """The tree as text, the same under every version of Python, so that a new Python does not make results look stale."""
    if sys.version_info < (3, 12):
        return ast.dump(tree)
    for node in ast.walk(tree):
        if vars(node).get("type_params") == []:
            del vars(node)["type_params"]
        if isinstance(node, ast.JoinedStr):
            # Early releases of 3.12 end some f-strings with an empty part.
            node.values = [part for part in node.values if not (isinstance(part, ast.Constant) and part.value == "")]
    return ast.dump(tree, show_empty=True) if sys.version_info >= (3, 13) else ast.dump(tree)


def _is_text(node: ast.AST) -> bool:
    """Whether a statement is only a string, such as a docstring."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _code(module: str) -> bytes:
    """Digest of a module's code without comments, docstrings and formatting."""
    return bytes.fromhex(_facts(module).code)


def _data_files(folder: Path) -> Iterator[Path]:
    """Files below a package's folder that are not code; packages inside it are skipped."""
    for entry in sorted(os.scandir(folder), key=lambda entry: entry.name):
        if entry.name.startswith(".") or entry.name == "__pycache__":
            continue
        path = Path(entry.path)
        if entry.is_dir():
            if not (path / "__init__.py").is_file():
                yield from _data_files(path)
        elif path.suffix not in (".py", ".pyc"):
            yield path


@functools.cache
def _data(module: str) -> bytes:
    """Digest of the names and contents of a package's data files; the digest of nothing for a module that is no package."""
    path, digest = module_file(module), hashlib.sha256()
    if path is not None and path.name == "__init__.py":
        for file in _data_files(path.parent):
            digest.update(f"{file.relative_to(path.parent)}\0".encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.digest()


def _parents(module: str) -> list[str]:
    """The packages that Python imports on the way to a module."""
    parts = module.split(".")
    names = (".".join(parts[:count]) for count in range(1, len(parts)))
    return [name for name in names if module_file(name) is not None]


@functools.cache
def direct_imports(module: str) -> frozenset[str]:
    """Modules of the checkout that a module imports anywhere in its text, or names in a string, with the packages above them.

    Raises:
        ValueError: The module uses a relative import; this reader follows absolute ones only.
    """
    facts = _facts(module)
    if facts.relative:
        raise ValueError(f"{module} uses a relative import")
    found = {name for name in facts.imports if module_file(name) is not None}
    return frozenset(found.union(*(_parents(name) for name in found)))


def import_closure(modules: Iterable[str]) -> frozenset[str]:
    """The given modules and all modules of the checkout that they import, directly or not, without `WITHOUT_EFFECT`."""
    return frozenset().union(*(_closure(module) for module in modules))


@functools.cache
def _closure(root: str) -> frozenset[str]:
    closure: set[str] = set()
    waiting = [root]
    while waiting:
        module = waiting.pop()
        if module in closure or module in WITHOUT_EFFECT:
            continue
        closure.add(module)
        waiting.extend(direct_imports(module))
        waiting.extend(_parents(module))
    return frozenset(closure)


def code_digest(*modules: str) -> str:
    """Digest of the import closure of the given modules: its code and the data files that belong to its packages.

    Raises:
        ValueError: There is no such module.
    """
    digest = hashlib.sha256()
    # Data files of the library's top folder belong to no single package, so any module could read them.
    digest.update(_data(NAME))
    for module in sorted(import_closure(modules)):
        digest.update(module.encode())
        digest.update(_code(module))
        digest.update(_data(module))
    return digest.hexdigest()[:12]


def script_digest(script: str) -> str:
    """Digest of a script of `scripts/`, named without its ending, and of all code that it reaches, for a rule's `params`.

    Raises:
        ValueError: There is no such script.
    """
    return code_digest(f"scripts.{script}")


def kernel_modules() -> list[Path]:
    """Modules of the package that define compiled kernels."""
    pattern = re.compile(r"^from gsbridge\.kernels import", re.MULTILINE)
    return sorted(path for path in PACKAGE.rglob("*.py") if pattern.search(path.read_text(encoding="utf-8")))


def kernel_digest() -> str:
    """Digest of all kernel modules and of their imports, since constants from other modules are compiled into a kernel."""
    names = (".".join([NAME, *path.relative_to(PACKAGE).with_suffix("").parts]) for path in kernel_modules())
    return code_digest(*(name.removesuffix(".__init__") for name in names))
