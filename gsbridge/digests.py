"""Digests of library code, so that an edit reruns exactly the stages that use it.

Snakemake watches a rule's script only. Each rule therefore carries, as a parameter, a digest over the static import closure
of the modules its script calls. Comments, docstrings and formatting do not count, nor do logging and error texts.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
NAME = PACKAGE.name
WITHOUT_EFFECT = frozenset({NAME, f"{NAME}.logs", f"{NAME}.errors", f"{NAME}.digests"})
"""Modules that cannot change a stage's result."""


def module_file(module: str) -> Path | None:
    """File of a module of the package, or None if there is no such module."""
    base = PACKAGE.joinpath(*module.split(".")[1:])
    for candidate in (base.with_suffix(".py"), base / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """The module and its statements at any depth, without their expressions, which are nearly all of a tree."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            waiting.extend(getattr(node, block, ()))


@functools.cache
def _tree(module: str) -> ast.Module:
    """Syntax tree of a module without docstrings."""
    path = module_file(module)
    if path is None:
        raise ValueError(f"there is no module {module}")
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in _statements(tree):
        body = getattr(node, "body", None)
        if not body:
            continue
        first = body[0]
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str):
            # An empty body would not be valid syntax; the digest only needs it to be constant.
            node.body = body[1:] or [ast.Pass()]  # type: ignore[attr-defined]
    return tree


@functools.cache
def _code(module: str) -> bytes:
    """What counts of a module. Most rules share most of their modules: to write each out anew took half of a dry run."""
    return ast.dump(_tree(module)).encode()


def _parents(module: str) -> list[str]:
    """The packages that Python imports on the way to a module."""
    parts = module.split(".")
    return [".".join(parts[:count]) for count in range(1, len(parts))]


@functools.cache
def direct_imports(module: str) -> frozenset[str]:
    """Modules of the package that a module imports, anywhere in its text.

    Raises:
        ValueError: A relative import: the package uses absolute ones, which this reader relies on.
    """
    found: set[str] = set()
    for node in _statements(_tree(module)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names if alias.name.split(".")[0] == NAME)
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                raise ValueError(f"{module} uses a relative import")
            if node.module and node.module.split(".")[0] == NAME:
                found.add(node.module)
                names = (f"{node.module}.{alias.name}" for alias in node.names)
                found.update(name for name in names if module_file(name) is not None)
    for name in list(found):
        found.update(_parents(name))
    return frozenset(found)


def import_closure(modules: Iterable[str]) -> frozenset[str]:
    """All modules of the package that the given ones import, directly or not, with the given ones."""
    closure: set[str] = set()
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        if module in closure or module in WITHOUT_EFFECT:
            continue
        closure.add(module)
        waiting.extend(direct_imports(module))
        waiting.extend(_parents(module))
    return frozenset(closure)


def code_digest(*modules: str) -> str:
    """Digest of the code behind the given modules, for a rule's `params`.

    Raises:
        ValueError: There is no such module.
    """
    digest = hashlib.sha256()
    for module in sorted(import_closure(modules)):
        digest.update(module.encode())
        digest.update(_code(module))
    return digest.hexdigest()[:12]


def package_digest(package: str) -> str:
    """Digest of the modules inside one package only, for outputs that outlive changes elsewhere (the mirror's films).

    Raises:
        ValueError: There is no such package.
    """
    root = PACKAGE.joinpath(*package.split(".")[1:])
    if not root.is_dir():
        raise ValueError(f"there is no package {package}")
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        module = ".".join([NAME, *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__")
        digest.update(module.encode())
        digest.update(_code(module))
    return digest.hexdigest()[:12]


def kernel_modules() -> list[Path]:
    """Modules of the package that define compiled kernels."""
    pattern = re.compile(r"^from gsbridge\.kernels import", re.MULTILINE)
    return sorted(path for path in PACKAGE.rglob("*.py") if pattern.search(path.read_text(encoding="utf-8")))


def kernel_digest() -> str:
    """Digest of all kernel modules and of what they import: a constant from another module is compiled into a kernel."""
    names = (".".join([NAME, *path.relative_to(PACKAGE).with_suffix("").parts]) for path in kernel_modules())
    return code_digest(*(name.removesuffix(".__init__") for name in names))
