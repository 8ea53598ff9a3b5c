"""The library's layers: a package imports only from layers below its own."""

import ast
import re
from pathlib import Path

import pytest

from gsbridge import digests

ROOT = Path(__file__).resolve().parents[2]
GROUND = "errors logs files given geometry cameras images meshes libraries kernels digests configuration statistics "
GROUND += "notebook run_status workflow_backups workflow_faults workflow_files workflow_lock workflow_plan workflow_storage "
GROUND += "workflow_targets reading"
FLOORS = [
    # The lowest layer has modules only, no packages; its modules may import one another.
    GROUND.split(),
    ["robot", "tasks", "effects", "experiment"],
    # Real2Sim: first what several stages measure with, then the stages, then what bundles or places their results.
    ["photogrammetry"],
    ["capture", "sfm", "align", "masks", "mesh", "splats"],
    ["asset", "registration"],
    ["sim", "scene", "reality"],
    ["environment"],
    ["policy"],
    ["gap"],
    ["report"],
    # A command may write a page.
    ["cli"],
    ["__main__"],
]
GAP_PARTS = ("benchmark", "contact", "diagnosis", "formats", "image", "joints", "joints.mechanism", "loop")
FLOOR_OF = {name: floor for floor, names in enumerate(FLOORS) for name in names}
ROOMS = ["tables", "figures", "pages", "scores", "gap", "recordings"]
"""Packages of the report; each imports only those before it."""
MODULES = sorted(ROOT.glob("gsbridge/**/*.py"))


def part_of(module: str) -> str:
    """Second part of a module's name: the package or module that has a floor."""
    return module.split(".")[1]


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@pytest.mark.parametrize("path", [path for path in MODULES if path.parent != ROOT / "gsbridge" or path.stem != "__init__"])
def test_imports_go_down_only(path):
    name = module_name(path)
    part = part_of(name)
    assert part in FLOOR_OF, f"{part} has no floor"
    for other in digests.direct_imports(name):
        if other.count(".") > 0 and part_of(other) != part:
            assert FLOOR_OF[part_of(other)] < FLOOR_OF[part] or FLOOR_OF[part] == 0, f"{name} imports {other}"


def test_no_import_closes_a_circle():
    names = [module_name(path) for path in MODULES]
    waiting, seen = {name: set(digests.direct_imports(name)) & set(names) - {name} for name in names}, set()
    # Importing a module also imports its package's __init__; that does not count as a dependency.
    for name, imports in waiting.items():
        waiting[name] = {other for other in imports if not name.startswith(other + ".") and not other.startswith(name + ".")}
    while waiting:
        free = [name for name, imports in waiting.items() if imports <= seen]
        assert free, f"circle among {sorted(waiting)}"
        seen.update(free)
        for name in free:
            del waiting[name]


def test_the_page_of_the_architecture_tells_these_floors():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").split("## Floors")[1].split("## ")[0]
    rows = [re.findall(r"`(\w+)`", line.split("|")[1]) for line in text.splitlines() if line.startswith("| `")]
    assert [sorted(row) for row in reversed(rows)] == [sorted(floor) for floor in FLOORS]


@pytest.mark.parametrize("room", ROOMS)
def test_rooms_of_the_report_build_on_one_another_in_one_direction(room):
    assert sorted(ROOMS) == sorted(path.parent.name for path in ROOT.glob("gsbridge/report/*/__init__.py"))
    assert [path.name for path in ROOT.glob("gsbridge/report/*.py")] == ["__init__.py"]
    for path in (ROOT / "gsbridge/report" / room).glob("*.py"):
        imported = digests.direct_imports(module_name(path))
        rooms = {other.split(".")[2] for other in imported if other.startswith("gsbridge.report.")}
        above = rooms & set(ROOMS[ROOMS.index(room) + 1 :])
        assert not above, f"{module_name(path)} imports {above}"


def parts_of(package: str) -> dict[str, set[str]]:
    """Modules and subpackages right below a package, and which of the others each imports, whatever is inside them."""
    level, imports = package.count(".") + 2, {}
    names = {module_name(path) for path in MODULES}

    def part(name: str) -> str:
        return ".".join(name.split(".")[:level])

    for name in names:
        if name.startswith(package + "."):
            others = {
                part(other) for other in digests.direct_imports(name) if other in names and other.startswith(package + ".")
            }
            imports.setdefault(part(name), set()).update(others - {part(name)})
    return imports


def longest_chain(imports: dict[str, set[str]]) -> list[str]:
    """The longest way down from one part to another; fails where a way comes back."""
    chains: dict[str, list[str]] = {}

    def down(name: str, above: tuple[str, ...]) -> list[str]:
        assert name not in above, f"packages import each other: {' > '.join((*above, name))}"
        if name not in chains:
            below = [down(other, (*above, name)) for other in sorted(imports[name])]
            chains[name] = [name, *max(below, key=len, default=[])]
        return chains[name]

    return max((down(name, ()) for name in sorted(imports)), key=len, default=[])


PACKAGES = sorted(module_name(path) for path in MODULES if path.stem == "__init__")


@pytest.mark.parametrize("package", PACKAGES)
def test_no_packages_import_each_other(package):
    """Though no module is in a circle, their packages may be: then neither can be read, moved or tested without the other."""
    longest_chain(parts_of(package))


@pytest.mark.parametrize(("package", "most"), [("gsbridge.gap", 8), *((f"gsbridge.gap.{name}", 9) for name in GAP_PARTS)])
def test_the_gap_has_few_floors(package, most):
    """The longest chain of modules and subpackages; each subpackage counts as one, and has floors of its own."""
    chain = longest_chain(parts_of(package))
    assert 0 < len(chain) <= most, " > ".join(chain)


def test_chains_and_circles_of_packages_are_found():
    assert longest_chain({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == ["a", "b", "c"]
    with pytest.raises(AssertionError, match="a > b > a"):
        longest_chain({"a": {"b"}, "b": {"a"}})


@pytest.mark.parametrize("path", MODULES)
def test_library_knows_nothing_of_snakemake_and_prints_nothing(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert all(alias.name.split(".")[0] != "snakemake" for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert (node.module or "").split(".")[0] != "snakemake"
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id != "print" or path.stem == "cli", f"{path} prints"


@pytest.mark.parametrize("path", MODULES)
def test_modules_are_small(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400


@pytest.mark.parametrize("path", sorted((ROOT / "scripts").glob("*.py")))
def test_scripts_are_thin(path):
    """A script reads snakemake's object, makes one call and decides nothing."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    assert len(lines) <= 45
    decisions = (ast.If, ast.For, ast.While, ast.Try, ast.FunctionDef)
    found = [node for node in ast.walk(tree) if isinstance(node, decisions)]
    type_checking = [node for node in found if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"]
    assert found == type_checking
