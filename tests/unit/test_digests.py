"""An edit of the code changes the digest of exactly the rules whose script reaches it."""

import ast
import hashlib
import json
import re
import subprocess
import sys
from modulefinder import ModuleFinder
from pathlib import Path

import pytest

from gsbridge import digests
from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.joints import JOINT_EFFECTS

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = sorted(path.stem for path in (ROOT / "scripts").glob("*.py"))
PROGRAMS = sorted(path.stem for path in (ROOT / "benchmarks").glob("*.py"))
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in ROOT.glob("gsbridge/**/*.py")
)
CACHES = (digests.module_file, digests._facts, digests._data, digests.direct_imports, digests._closure)


EVERY_PYTHON = '''
class Shape(object):
    sides: int = 4

    def told(self, *, wide: bool = False) -> str:
        """Doc."""
        note = f"{self.sides!r:>{10}} of {len([])} {{}}" f"{'wide' if wide else ''}"
        return note + f"{self.sides:.1f} "


async def nothing() -> None:
    global sides
    sides = [value for value in () if value is not None] or None
'''
"""What Python 3.12 and 3.13 write otherwise into a syntax tree: type parameters, parts of f-strings, empty lists."""


def forget():
    for cache in CACHES:
        cache.cache_clear()


@pytest.fixture
def package(tmp_path, monkeypatch):
    root = tmp_path / "gsbridge"
    (root / "sub" / "pages").mkdir(parents=True)
    (root / "named").mkdir()
    (tmp_path / "scripts").mkdir()
    (root / "__init__.py").write_text("")
    (root / "logs.py").write_text("def start(): pass\n")
    (root / "base.py").write_text('"""Doc."""\nX = 1\n')
    (root / "sub" / "__init__.py").write_text('"""Doc."""\n')
    (root / "sub" / "leaf.py").write_text("from gsbridge import base, logs\n\ndef f():\n    return base.X\n")
    (root / "sub" / "pages" / "page.html").write_text("<p>")
    (root / "named" / "__init__.py").write_text("")
    (root / "other.py").write_text("import importlib\n\nY = importlib.import_module('gsbridge.named')\n")
    (tmp_path / "scripts" / "leaf.py").write_text("from gsbridge.sub.leaf import f\n\nf()\n")
    (tmp_path / "scripts" / "other.py").write_text("from gsbridge import other\n")
    monkeypatch.setattr(digests, "PACKAGE", root)
    forget()
    yield root
    forget()


def test_closure_follows_imports(package):
    assert digests.import_closure(["gsbridge.sub.leaf"]) == {"gsbridge.sub.leaf", "gsbridge.sub", "gsbridge.base"}


@pytest.mark.parametrize(
    ("file", "text", "changed"),
    [
        ("base.py", '"""Another doc."""\n# a comment\nX = 1\n', set()),
        ("base.py", '"""Doc."""\nX = 1\n"""What X is."""\n', set()),
        ("base.py", '"""Doc."""\nX = 2\n', {"leaf"}),
        ("other.py", "Y = 3\n", {"other"}),
        ("logs.py", "def start(): return 1\n", set()),
        ("sub/__init__.py", "Z = 1\n", {"leaf"}),
        # A module that is imported by its name.
        ("named/__init__.py", "Z = 1\n", {"other"}),
        # Files beside the code.
        ("sub/pages/page.html", "<b>", {"leaf"}),
        ("sub/pages/new.html", "<p>", {"leaf"}),
        ("named/table.csv", "1\n", {"other"}),
        ("of_all.yaml", "a: 1\n", {"leaf", "other"}),
        # The scripts themselves.
        ("../scripts/leaf.py", "from gsbridge.sub.leaf import f\n\nf(1)\n", {"leaf"}),
        ("../scripts/other.py", "from gsbridge import other  # a comment\n", set()),
    ],
)
def test_digest_follows_meaning(package, file, text, changed):
    before = {name: digests.script_digest(name) for name in ("leaf", "other")}
    (package / file).write_text(text)
    forget()
    assert {name for name in before if digests.script_digest(name) != before[name]} == changed


def test_a_syntax_tree_is_the_same_text_on_every_python():
    """As `ast.dump` of Python 3.11 has it: neither results nor records are of other code on another Python."""
    text = digests._dumped(digests._tree(EVERY_PYTHON))
    assert hashlib.sha256(text.encode()).hexdigest() == "675466bc70a86996c56e8bd493e8fd1d4df4ce237297681e541a58617651dc7d"


def test_renaming_a_file_beside_the_code_counts(package):
    before = digests.script_digest("leaf")
    page = package / "sub" / "pages" / "page.html"
    page.rename(page.with_name("renamed.html"))
    forget()
    assert digests.script_digest("leaf") != before


def test_unknown_module_is_refused(package):
    with pytest.raises(ValueError, match="no module"):
        digests.code_digest("gsbridge.none")
    with pytest.raises(ValueError, match=r"no module scripts\.none"):
        digests.script_digest("none")


def imports_of(code) -> set[str]:
    """Names in the import instructions of bytecode, by the standard library's reader: digests read syntax instead."""
    found: set[str] = set()
    for kind, what in ModuleFinder().scan_opcodes(code):
        if kind == "absolute_import":
            names, module = what
            found.update([module, *(f"{module}.{name}" for name in names or ())])
    return found.union(*(imports_of(constant) for constant in code.co_consts if isinstance(constant, type(code))))


def reached_by(edges: dict[str, set[str]], name: str) -> set[str]:
    """Modules of the library that running a file imports, at any depth."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        module = waiting.pop()
        parts = module.split(".")
        for other in [".".join(parts[:count]) for count in range(1, len(parts) + 1)]:
            if other in edges and other not in found:
                found.add(other)
                waiting.extend(edges[other])
    return found


@pytest.fixture(scope="module")
def edges():
    """Who imports whom, as the bytecode of every file says it."""
    files = {name: digests.module_file(name) for name in MODULES}
    files |= {f"scripts.{name}": ROOT / "scripts" / f"{name}.py" for name in SCRIPTS}
    files |= {f"benchmarks.{name}": ROOT / "benchmarks" / f"{name}.py" for name in PROGRAMS}
    found = {name: imports_of(compile(path.read_text(encoding="utf-8"), name, "exec")) for name, path in files.items()}
    # The root package loads the names that it offers only when they are used, and no module of gsbridge uses them (next test).
    return {**found, "gsbridge": set()}


def test_code_of_ours_imports_names_from_the_modules_that_define_them():
    """Through the names that the root package offers to other programs, an import would not show what it reaches."""
    for path in (path for folder in digests.FOLLOWED for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module == "gsbridge":
                names = {alias.name for alias in node.names} - {"__version__"}
                assert all(digests.module_file(f"gsbridge.{name}") for name in names), path


def test_every_edit_of_the_library_changes_exactly_the_rules_that_reach_it(edges, monkeypatch):
    """Over the real tree: the digests of all rules, with each module's code changed in its turn."""
    roots = [*(f"scripts.{name}" for name in SCRIPTS), *(f"benchmarks.{name}" for name in PROGRAMS)]
    reached = {name: reached_by(edges, name) for name in roots}
    plain = digests._code
    before = {name: digests.code_digest(name) for name in roots}
    closures = {name: digests.import_closure([name]) for name in roots}
    users = {module: [name for name in roots if module in closures[name]] for module in MODULES}
    for module in MODULES:
        expected = {name for name in roots if module in reached[name]} if module not in digests.WITHOUT_EFFECT else set()
        monkeypatch.setattr(digests, "_code", lambda name, module=module: plain(name) + b"1" * (name == module))
        # A digest whose closure lacks the module cannot change; computing one such digest checks this.
        others = [name for name in roots if name not in users[module]][:1]
        changed = {name for name in [*users[module], *others] if digests.code_digest(name) != before[name]}
        assert changed == expected, module


def test_every_module_of_the_library_is_read(edges):
    """What no script reaches is a command's, or belongs to a package of programs."""
    reached = set().union(*(reached_by(edges, f"scripts.{name}") for name in SCRIPTS))
    assert len(reached) > 0.8 * len(MODULES)
    assert set(SCRIPTS) >= {"train_policy", "diagnose_joint_cases"}


RUN = """
import json, sys, types
for name in ("train_policy", "diagnose_joint_cases", "report_gap"):
    code = compile(open(f"scripts/{name}.py").read(), name, "exec")
    try:
        exec(code, {"__name__": "__main__"})
    except NameError as error:
        # The imports are done: snakemake's object comes after them.
        assert "snakemake" in str(error), error
    print(json.dumps([name, sorted(module for module in sys.modules if module.startswith("gsbridge"))]))
    for module in [module for module in sys.modules if module.startswith("gsbridge")]:
        del sys.modules[module]
"""


def test_what_python_imports_is_in_the_digest():
    """Of some scripts that reach far, what is loaded once their imports are done."""
    done = subprocess.run([sys.executable, "-c", RUN], cwd=ROOT, capture_output=True, text=True, check=True)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(lines) == 3
    for name, loaded in lines:
        closure = digests.import_closure([f"scripts.{name}"])
        assert set(loaded) - digests.WITHOUT_EFFECT <= closure, name


EFFECTS = [
    (type(effect).__module__, place)
    for place, effects in {"joints": JOINT_EFFECTS, "bodies": BODY_EFFECTS, "images": IMAGE_EFFECTS}.items()
    for effect in effects.values()
]
USERS_OF_EFFECTS = {
    "joints": ["identify_gap", "diagnose_joint_cases", "amend_simulation", "train_policy"],
    "bodies": ["identify_gap", "diagnose_thrown_cases", "amend_object", "train_policy"],
    "images": ["identify_gap", "diagnose_photo_cases", "diagnose_photos", "amend_camera", "train_policy"],
}


@pytest.mark.parametrize(("module", "place"), EFFECTS, ids=[module.removeprefix("gsbridge.effects.") for module, _ in EFFECTS])
def test_editing_an_effect_reruns_its_users(module, place):
    assert module not in digests.WITHOUT_EFFECT
    for script in USERS_OF_EFFECTS[place]:
        assert module in digests.import_closure([f"scripts.{script}"]), script


def test_a_kind_of_the_gap_s_cases_is_diagnosed_by_its_own_code():
    """An edit of one backend reruns its own cases alone, and leaves the recorded figures about the others fresh."""
    backends = {"joint": "joints", "thrown": "contact", "photo": "image"}
    found = {kind: digests.import_closure([f"scripts.diagnose_{kind}_cases"]) for kind in backends}
    for kind, own in backends.items():
        assert f"gsbridge.gap.{own}.diagnose" in found[kind]
        for other in set(backends.values()) - {own}:
            assert f"gsbridge.gap.{other}.diagnose" not in found[kind], (kind, other)
    # Neither drawing nor judging needs a diagnosis.
    for script in ("generate_gap_cases", "score_gap_cases"):
        closure = digests.import_closure([f"scripts.{script}"])
        assert not [own for own in backends.values() if f"gsbridge.gap.{own}.diagnose" in closure], script


def test_nothing_is_read_or_imported_by_a_way_that_imports_do_not_show():
    """Data of the library lies in its packages' folders, and modules of ours are imported by statements."""
    # They may use `__file__`: to find the checkout, to name a log line's file, and to recognise lines of a user's driver.
    places = {"gsbridge/digests.py", "gsbridge/logs.py", "gsbridge/policy/driver.py"}
    # They may import by name: for names of other programs, optional third-party packages, and a user's own driver.
    imports = {"gsbridge/__init__.py", "gsbridge/policy/driver.py", "gsbridge/gap/formats/mcap.py", "gsbridge/masks/sam2.py"}
    for path in ROOT.glob("gsbridge/**/*.py"):
        name, text = str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")
        assert not re.search(r"(?<!Path\()__file__|__file__\)(?!\.parent\b(?!\.parent))", text) or name in places, name
        assert not re.search(r"import_module\(|__import__\(|spec_from_file|pkgutil|runpy", text) or name in imports, name


def rules():
    """Text of each rule by its name."""
    for path in sorted((ROOT / "rules").glob("*.smk")):
        for text in re.split(r"(?m)^(?=rule )", path.read_text())[1:]:
            yield re.match(r"rule (\w+):", text)[1], text


@pytest.mark.parametrize(("name", "text"), rules(), ids=[name for name, _ in rules()])
def test_every_rule_carries_the_digest_of_what_it_runs(name, text):
    script = re.search(r'script:\s+"\.\./scripts/(\w+)\.py"', text)
    program = re.search(r'program=program\("(\w+)"\)', text)
    if script:
        assert f'code=script_digest("{script[1]}"),' in text
    elif program:
        assert f'code=code_digest("benchmarks.{program[1]}"),' in text
    else:
        # A target, or a copy that rests with the shell.
        assert "shell:" not in text or name in ("record_scores", "copy_project_file")
        assert "run:" not in text


def test_every_script_is_run_by_a_rule():
    run = {script for _, text in rules() for script in re.findall(r'"\.\./scripts/(\w+)\.py"', text)}
    assert run == set(SCRIPTS)


def test_no_parameter_is_a_date():
    for path in [*(ROOT / "rules").glob("*.smk"), *(ROOT / "gsbridge").glob("*.py")]:
        assert not re.search(r"st_mtime|getmtime", path.read_text()), path.name


def test_scripts_import_at_their_top():
    """An import inside a function would be followed, but would not show what python loads."""
    for name in SCRIPTS:
        tree = ast.parse((ROOT / "scripts" / f"{name}.py").read_text())
        assert all(not isinstance(node, ast.FunctionDef) for node in ast.walk(tree)), name
