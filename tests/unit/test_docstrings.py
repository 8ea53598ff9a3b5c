"""Every public name of the library says what it does, and every longer signature what its arguments are.

The walk is over the source: nothing is imported, so that optional packages and compiled kernels do not matter.
"""

import ast
import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import gsbridge

LIBRARY = Path(gsbridge.__file__).parent
# A function of fewer arguments says in a sentence what they are.
MANY = 3
ARRAYS = {"Array", "ArrayLike", "NDArray", "ndarray", "Tensor"}
# `[N, 3]`, `[H, W]`; `[...]` where any shape will do.
SHAPE = re.compile(r'\[[^\[\]"]*\]')

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Public:
    """A public module, class or function.

    Args:
        where: File and dotted name, for messages.
        name: Its own name.
        owner: The class that holds it, None for a function of a module.
        node: Its source.
        arrays: Names of array types in its module.
    """

    where: str
    name: str
    owner: ast.ClassDef | None
    node: ast.Module | ast.ClassDef | Function
    arrays: set[str]


def decorators(node: Function) -> set[str]:
    """Last parts of the names of what decorates a function: `overload` for `typing.overload`."""
    roots = [d.func if isinstance(d, ast.Call) else d for d in node.decorator_list]
    return {ast.unparse(root).rsplit(".", 1)[-1] for root in roots}


def walk(module: ast.Module, label: str) -> Iterator[Public]:
    """The public names of a module, from the outside in; overloads and setters belong to what they overload and set."""

    def inside(parent: ast.Module | ast.ClassDef, prefix: str) -> Iterator[Public]:
        owner = parent if isinstance(parent, ast.ClassDef) else None
        for node in parent.body:
            if not isinstance(node, ast.ClassDef | Function) or node.name.startswith("_"):
                continue
            if isinstance(node, Function) and decorators(node) & {"overload", "setter", "deleter"}:
                continue
            yield Public(f"{label}: {prefix}{node.name}", node.name, owner, node, arrays)
            if isinstance(node, ast.ClassDef):
                yield from inside(node, f"{prefix}{node.name}.")

    arrays = array_names(module)
    yield Public(label, label, None, module, arrays)
    yield from inside(module, "")


def arguments(node: Function, owner: ast.ClassDef | None) -> list[str]:
    """Names that a caller gives, without what Python or numba passes by itself."""
    listed = [a.arg for a in node.args.posonlyargs + node.args.args]
    marks = decorators(node)
    by_itself = (owner is not None and "staticmethod" not in marks) or "intrinsic" in marks
    named = listed[1:] if by_itself else listed
    named += [a.arg for a in node.args.kwonlyargs]
    return named + [a.arg for a in (node.args.vararg, node.args.kwarg) if a is not None]


def entries(docstring: str) -> dict[str, str]:
    """What the section `Args:` of a docstring says of each argument."""
    lines = inspect.cleandoc(docstring).splitlines()
    said: dict[str, str] = {}
    names: list[str] = []
    for line in lines[lines.index("Args:") + 1 :] if "Args:" in lines else []:
        if line and not line.startswith(" "):
            break
        entry = re.match(r" {4}(\*{0,2}\w+(?:, \*{0,2}\w+)*): (\S.*)", line)
        if entry:
            names = [name.strip(" *") for name in entry[1].split(",")]
        for name in names:
            said[name] = f"{said.get(name, '')} {entry[2] if entry else line.strip()}"
    return said


def documented(docstring: str) -> set[str] | None:
    """Names that the section `Args:` of a docstring explains; None when there is no such section."""
    return set(entries(docstring)) if "Args:" in inspect.cleandoc(docstring).splitlines() else None


def undocumented(found: Public) -> set[str]:
    """Arguments of a function that its docstring leaves unexplained."""
    assert isinstance(found.node, Function)
    named = arguments(found.node, found.owner)
    if len(named) < MANY:
        return set()
    return set(named) - (documented(ast.get_docstring(found.node) or "") or set())


def holds_arrays(annotation: ast.expr | None, names: set[str]) -> bool:
    """Whether an annotation names an array, alone or in a container; what a function takes or gives does not count."""
    if isinstance(annotation, ast.Subscript) and ast.unparse(annotation.value).endswith("Callable"):
        return False
    if isinstance(annotation, ast.Name | ast.Attribute):
        return ast.unparse(annotation).rsplit(".", 1)[-1] in names
    return annotation is not None and any(holds_arrays(part, names) for part in ast.iter_child_nodes(annotation))  # type: ignore[arg-type]


def array_names(module: ast.Module) -> set[str]:
    """Names of array types in a module, with those that it gives to arrays itself: `Picture = Array`."""
    names = set(ARRAYS)
    for node in module.body:
        calls = any(isinstance(part, ast.Call) for part in ast.walk(node))
        if isinstance(node, ast.Assign) and not calls and holds_arrays(node.value, names):
            names.update(target.id for target in node.targets if isinstance(target, ast.Name))
    return names


def unshaped(found: Public) -> set[str]:
    """Array arguments of a function whose shape its docstring does not state: in `Args:`, or anywhere where it has none."""
    assert isinstance(found.node, Function)
    listed = [*found.node.args.posonlyargs, *found.node.args.args, *found.node.args.kwonlyargs]
    arrays = {argument.arg for argument in listed if holds_arrays(argument.annotation, found.arrays)}
    docstring = ast.get_docstring(found.node) or ""
    said = entries(docstring)
    return {name for name in arrays if not SHAPE.search(said.get(name, "") if said else docstring)}


def explained(library: list[Public]) -> set[tuple[str, str]]:
    """Pairs of class and method whose arguments are explained: by the method itself, or by the one that it overrides."""
    methods = {(f.owner.name, f.name): f for f in library if f.owner and isinstance(f.node, Function)}
    bases: dict[str, set[str]] = {}
    for found in library:
        if isinstance(found.node, ast.ClassDef):
            roots = [base.value if isinstance(base, ast.Subscript) else base for base in found.node.bases]
            bases.setdefault(found.name, set()).update(ast.unparse(root).rsplit(".", 1)[-1] for root in roots)

    def holds(owner: str, name: str, wanted: list[str], seen: frozenset[str]) -> bool:
        found = methods.get((owner, name))
        if (
            found
            and isinstance(found.node, Function)
            and arguments(found.node, found.owner) == wanted
            and not undocumented(found)
        ):
            return True
        return any(holds(base, name, wanted, seen | {base}) for base in bases.get(owner, set()) - seen)

    out = set()
    for (owner, name), found in methods.items():
        assert isinstance(found.node, Function)
        if holds(owner, name, arguments(found.node, found.owner), frozenset({owner})):
            out.add((owner, name))
    return out


def public_names(root: Path) -> list[Public]:
    """Public names of every module below a folder."""
    files = sorted(root.rglob("*.py"))
    return [found for file in files for found in walk(ast.parse(file.read_text()), str(file.relative_to(root)))]


@pytest.fixture(scope="module")
def library() -> list[Public]:
    return public_names(LIBRARY)


def test_every_public_name_has_a_docstring(library: list[Public]) -> None:
    bare = [found.where for found in library if not ast.get_docstring(found.node)]

    assert bare == []
    assert len(library) > 1000


def test_every_longer_signature_explains_its_arguments(library: list[Public]) -> None:
    by_base = explained(library)
    functions = [found for found in library if isinstance(found.node, Function)]
    inherited = {id(found) for found in functions if found.owner and (found.owner.name, found.name) in by_base}
    lacking = {f.where: sorted(undocumented(f)) for f in functions if id(f) not in inherited and undocumented(f)}

    assert lacking == {}


def test_every_array_argument_has_a_shape(library: list[Public]) -> None:
    by_base = explained(library)
    functions = [found for found in library if isinstance(found.node, Function)]
    # A method that leaves its arguments to the one it overrides leaves the shapes to it, too.
    own = [f for f in functions if not (undocumented(f) and f.owner and (f.owner.name, f.name) in by_base)]
    lacking = {found.where: sorted(unshaped(found)) for found in own if unshaped(found)}

    assert lacking == {}


def test_no_docstring_explains_an_argument_that_is_not_there(library: list[Public]) -> None:
    extra = {}
    for found in library:
        if isinstance(found.node, Function):
            named = documented(ast.get_docstring(found.node) or "") or set()
            if named - set(arguments(found.node, found.owner)):
                extra[found.where] = sorted(named - set(arguments(found.node, found.owner)))

    assert extra == {}


BROKEN = '''
"""A module."""

class Base:
    """A base."""

    def fit(self, mesh, spacing, seed):
        """Fit.

        Args:
            mesh: A mesh.
            spacing, seed: Metres, and a number.
        """

class Child(Base):
    """A child."""

    def fit(self, mesh, spacing, seed):
        """Fit otherwise."""

    def other(self, mesh, spacing, *, seed):
        """Say `mesh`, `spacing` and `seed`, but in no section.

        Args:
            mesh: A mesh.
            spacing: Metres.
            speed: A mistake for the seed.
        """

def bare(x):
    pass

Picture = Array
Step = Callable[[Array], Array]

def draw(picture: Picture, points: Sequence[Array], weights: Array | None, step: Step):
    """Draw.

    Args:
        picture: Picture, 0..1.
        points: Points, m. [N, 3] each.
        weights: Weights; `steps["first"]` where None.
        step: A step.
    """

def turn(points: Array):
    """Turn points. [N, 3] -> [N, 3]."""

def shift(points: Array):
    """Shift points."""
'''


def test_the_walk_finds_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text(BROKEN)
    library = public_names(tmp_path)
    by_name = {found.where.removeprefix("broken.py: "): found for found in library}

    assert [found.where for found in library if not ast.get_docstring(found.node)] == ["broken.py: bare"]
    assert undocumented(by_name["Child.other"]) == {"seed"}
    assert undocumented(by_name["Child.fit"]) == {"mesh", "spacing", "seed"}
    assert explained(library) == {("Base", "fit"), ("Child", "fit")}
    with pytest.raises(AssertionError):
        test_every_public_name_has_a_docstring(library)
    with pytest.raises(AssertionError, match="other"):
        test_every_longer_signature_explains_its_arguments(library)
    assert unshaped(by_name["draw"]) == {"picture", "weights"}
    assert unshaped(by_name["turn"]) == set()
    with pytest.raises(AssertionError, match="shift"):
        test_every_array_argument_has_a_shape(library)
    with pytest.raises(AssertionError, match="speed"):
        test_no_docstring_explains_an_argument_that_is_not_there(library)
