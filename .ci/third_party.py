"""Write THIRD_PARTY.md: the licence of every package of the locks, as its own metadata state it.

python .ci/third_party.py
"""

import re
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "THIRD_PARTY.md"
COPYLEFT = re.compile(r"\b[AL]?GPL|GNU (Affero |Lesser )?General Public", re.IGNORECASE)
"""Licences that ask something of whoever passes the package on together with others."""
HEAD = """\
# Third-party packages

gsbridge itself is Apache-2.0 and holds no copied code. `make setup` installs the packages below from PyPI; each stays
under its own licence, as its metadata state it. Written by `python .ci/third_party.py`.

**What the GPL means here.** {copyleft} under the General Public License. You may use gsbridge with it for anything,
commercial work included, and what you compute with it is yours. Who passes on a *bundle* that holds it, such as a
container image or an installer with all packages inside, must do that under its terms: with its source or an offer of it,
and without further restrictions. Apache-2.0 is compatible with version 3 of the GPL, so that such a bundle is possible;
closed additions that build on it are not. To pass on gsbridge alone, as source or as a wheel, without the packages, is no
distribution of it. gsbridge calls it to make meshes of even triangles, in `gsbridge/mesh/repair.py` and
`gsbridge/splats/remesh.py`, and nowhere else.

{lesser} under the Lesser GPL: it may be part of any bundle as long as it can be exchanged for another version. This is
how we read the licences, and no legal advice.

**What goes over the network.** gsbridge sends nothing. The `rerun` viewer, which opens recordings, reports anonymous
figures of its use to its makers unless `rerun analytics disable` was called once.

| package | version | licence |
|---|---|---|
"""


def locked() -> dict[str, str]:
    """Versions by package, as the locks pin them, but for what only other systems and CUDA need."""
    text = "".join((ROOT / f"requirements{part}.lock").read_text(encoding="utf-8") for part in ("", "-torch", "-test"))
    pinned = re.findall(r"^([\w.-]+)==([^ ;]+) ?(;.*)?\\$", text, re.MULTILINE)
    elsewhere = re.compile(r"sys_platform == '(win32|emscripten)'|python_full_version >= '3\.1[2-9]'")
    cuda = re.compile(r"nvidia-|cuda-|triton$")
    found = {name: version for name, version, marker in pinned if not elsewhere.search(marker) and not cuda.match(name)}
    return dict(sorted(found.items(), key=lambda item: item[0].lower()))


def licence(package: str, version: str) -> str | None:
    """Licence as the package states it, in a few words; None where this version is not installed or states none."""
    try:
        stated = metadata.metadata(package)
    except metadata.PackageNotFoundError:
        return None
    if stated["Version"] != version:
        return None
    if stated["License-Expression"]:
        return str(stated["License-Expression"])
    classifiers = [line.rsplit(" :: ", 1)[1] for line in stated.get_all("Classifier", []) if line.startswith("License :: ")]
    short = (stated["License"] or "").strip().splitlines()
    # Some put the whole text where a name belongs, and some have it in a file only, which begins with its name.
    named = short[0] if len(short) == 1 and len(short[0]) < 60 else ""
    known = [name for name in classifiers if name != "OSI Approved"]
    return ", ".join(known) or named or _first_line_of_its_file(package)


def _first_line_of_its_file(package: str) -> str | None:
    """`MIT License`, where a file of that text is all that tells."""
    for file in metadata.files(package) or []:
        if re.fullmatch(r"LICEN[CS]E(\.\w+)?", file.name):
            lines = Path(str(file.locate())).read_text(encoding="utf-8").strip().splitlines()
            if re.fullmatch(r"(The )?(MIT|BSD|Apache) License.{0,20}", lines[0].strip()):
                return lines[0].strip()
    return None


def rows(before: str) -> dict[str, tuple[str, str]]:
    """Version and licence by package; of packages that are not installed here, the licence that stood on the page before.

    Raises:
        SystemExit: The licence of a package is not known.
    """
    old = {row[0]: row[2] for row in re.findall(r"^\| (\S+) \| (\S+) \| (.+) \|$", before, re.MULTILINE)}
    found = {}
    for package, version in locked().items():
        stated = licence(package, version) or old.get(package)
        if stated is None:
            raise SystemExit(f"the licence of {package} is not known: it is not installed, or its metadata do not tell")
        found[package] = (version, stated.replace("|", "/"))
    return found


def _stands(names: list[str]) -> str:
    return f"{' and '.join(names)} {'stands' if len(names) == 1 else 'stand'}"


def page() -> str:
    """The text of THIRD_PARTY.md."""
    found = rows(PAGE.read_text(encoding="utf-8") if PAGE.is_file() else "")
    # One of several licences may be of a tool beside the package, and is on its line.
    strict = [name for name, (_, kind) in found.items() if all(COPYLEFT.search(part) for part in kind.split(", "))]
    lesser = [name for name in strict if re.search(r"Lesser|LGPL", found[name][1])]
    copyleft = [name for name in strict if name not in lesser]
    head = HEAD.format(copyleft=_stands(copyleft), lesser=_stands(lesser))
    return head + "".join(f"| {name} | {version} | {kind} |\n" for name, (version, kind) in found.items())


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
