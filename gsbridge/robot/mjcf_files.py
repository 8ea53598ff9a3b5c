"""Files that an MJCF names, without MuJoCo: what the workflow has to watch."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree


def mjcf_files(path: str | Path) -> list[Path]:
    """Files that an MJCF names, as far as they are there: what it includes, and meshes, whose shapes may give masses."""
    # A pipe would never end.
    if not Path(path).is_file():
        return []
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError, LookupError, ValueError):
        return []
    folder, compiler = Path(path).parent, root.find("compiler")
    places = [folder, *(folder / compiler.get(key, "") for key in ("meshdir", "assetdir") if compiler is not None)]
    named = [element.get("file", "") for element in root.iter()]
    return [place / name for name in dict.fromkeys(named) if name for place in places if (place / name).is_file()]
