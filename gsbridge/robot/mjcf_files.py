"""Files that an MJCF names, found without MuJoCo, so that the workflow can watch them for changes."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from gsbridge.errors import InputError
from gsbridge.reading import LARGEST_TEXT, refusing, regular_file

_MEND = "Correct the MJCF"


def mjcf_files(path: str | Path) -> list[Path]:
    """Return the existing files that an MJCF names: included files, and meshes, whose shapes may give masses."""
    return [place for place in mjcf_named(path) if place.is_file()]


def mjcf_named(path: str | Path) -> list[Path]:
    """Return the existing paths at which MuJoCo may look for files that an MJCF, or a file it includes, names."""
    folders, names, waiting, seen = {Path(path).parent}, dict[str, None](), [Path(path)], set[Path]()
    found: dict[Path, None] = {}
    while waiting:
        file = waiting.pop()
        try:
            with refusing(file, "this is no valid XML", _MEND):
                seen.add(file.resolve())
                root = ElementTree.parse(regular_file(file, "MJCF", _MEND, LARGEST_TEXT)).getroot()
        except InputError:
            continue
        folders.add(file.parent)
        for compiler in root.iter("compiler"):
            stated = [compiler.get(key, "") for key in ("meshdir", "texturedir", "assetdir")]
            folders |= {parent / folder for parent in list(folders) for folder in stated if folder}
        named = [value for element in root.iter() for key, value in element.attrib.items() if key.startswith("file") and value]
        names |= dict.fromkeys(part for name in named for part in (name, Path(name).name))
        found |= dict.fromkeys(folder / name for name in names for folder in sorted(folders) if _is_there(folder / name))
        waiting += [other for other in found if other.suffix == ".xml" and other.resolve() not in seen and other not in waiting]
    return list(found)


def _is_there(path: Path) -> bool:
    """Whether a path exists; False for a name that the operating system does not accept."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False
