"""Files that an MJCF names, without MuJoCo: what the workflow has to watch."""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree

from gsbridge.errors import InputError
from gsbridge.reading import LARGEST_TEXT, refusing, regular_file

_MEND = "Correct the MJCF"


def mjcf_files(path: str | Path) -> list[Path]:
    """Files that an MJCF names, as far as they are there: what it includes, and meshes, whose shapes may give masses."""
    return [place for place in mjcf_named(path) if place.is_file()]


def mjcf_named(path: str | Path) -> list[Path]:
    """All places at which MuJoCo may look for what an MJCF names, whatever is there."""
    try:
        with refusing(path, "this is no valid XML", _MEND):
            root = ElementTree.parse(regular_file(path, "MJCF", _MEND, LARGEST_TEXT)).getroot()
            folder, compiler = Path(path).parent, root.find("compiler")
            places = [folder, *(folder / compiler.get(key, "") for key in ("meshdir", "assetdir") if compiler is not None)]
            named = [element.get("file", "") for element in root.iter()]
            found = [place / name for name in dict.fromkeys(named) if name for place in places]
            return [place for place in found if os.path.exists(place)]
    except InputError:
        return []
