"""The library's floors, and what may stand where."""

import ast
from pathlib import Path

import pytest

from gsbridge import digests

ROOT = Path(__file__).resolve().parents[2]
GROUND = "errors logs files geometry cameras images meshes libraries kernels digests configuration schema statistics "
GROUND += "run_status workflow_lock"
FLOORS = [
    # The ground floor has no packages; its modules may build on one another.
    GROUND.split(),
    ["robot", "tasks", "effects"],
    # Real2Sim: what several stages measure with, the stages, and what bundles or places the stages' results.
    ["photogrammetry"],
    ["capture", "sfm", "align", "masks", "mesh", "splats"],
    ["asset", "registration"],
    ["sim", "scene", "reality"],
    ["environment"],
    ["policy"],
    ["gap"],
    ["report", "cli"],
    ["__main__"],
]
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
    # A package's __init__ is imported on the way to its modules; that is no dependency of its own.
    for name, imports in waiting.items():
        waiting[name] = {other for other in imports if not name.startswith(other + ".") and not other.startswith(name + ".")}
    while waiting:
        free = [name for name, imports in waiting.items() if imports <= seen]
        assert free, f"circle among {sorted(waiting)}"
        seen.update(free)
        for name in free:
            del waiting[name]


@pytest.mark.parametrize("room", ROOMS)
def test_rooms_of_the_report_build_on_one_another_in_one_direction(room):
    assert sorted(ROOMS) == sorted(path.parent.name for path in ROOT.glob("gsbridge/report/*/__init__.py"))
    assert [path.name for path in ROOT.glob("gsbridge/report/*.py")] == ["__init__.py"]
    for path in (ROOT / "gsbridge/report" / room).glob("*.py"):
        imported = digests.direct_imports(module_name(path))
        rooms = {other.split(".")[2] for other in imported if other.startswith("gsbridge.report.")}
        above = rooms & set(ROOMS[ROOMS.index(room) + 1 :])
        assert not above, f"{module_name(path)} imports {above}"


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
