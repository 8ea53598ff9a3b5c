"""Hooks of mkdocs: the pages of the root belong to the site, and lists nest as they do where the project is hosted."""

from __future__ import annotations

import json
import posixpath
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "README.md": "index.md",
    **{f"{name}.md": f"{name}.md" for name in ("CONTRIBUTING", "CHANGELOG", "SECURITY", "THIRD_PARTY")},
}
PAGES |= {"benchmarks/RESULTS.md": "benchmarks/RESULTS.md"}
OTHERS = ("CITATION.cff", "LICENSE")
"""Files that pages of the root link to, taken as they are."""

_LINK = re.compile(r"(\]\()((?!https?://|mailto:|#)[^()\s]+)(\))")
_ITEM = re.compile(r"^\d+\. ")


def version() -> str:
    """The version that the pages describe."""
    found = re.search(r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE)
    return found[1] if found else ""


def on_config(config: Any) -> Any:
    """Say which version is described, and give it a folder of its own beside those of other versions."""
    config.copyright = f"gsbridge {version()}"
    # Not where pages are only shown while one writes them.
    if Path(config.site_dir) == ROOT / "site":
        config.site_dir = str(ROOT / "site" / version())
    return config


def on_post_build(config: Any) -> None:
    """List the versions that lie side by side, from which a reader chooses; the newest is what the site begins with."""
    place = Path(config.site_dir)
    if place.name == version():
        list_versions(place.parent)


def list_versions(site: Path) -> None:
    """Write the list of versions as the theme's menu reads it, and the page that leads to the newest.

    Args:
        site: Folder with a folder for each version.
    """
    names = [page.parent.name for page in site.glob("*/index.html")]
    names.sort(key=lambda name: [int(part) for part in re.findall(r"\d+", name)], reverse=True)
    listed = [{"version": name, "title": name, "aliases": ["latest"] if name == names[0] else []} for name in names]
    (site / "versions.json").write_text(json.dumps(listed, indent=1) + "\n", encoding="utf-8")
    first = f"{names[0]}/index.html"
    head = f'<!doctype html><meta charset="utf-8"><title>gsbridge</title><meta http-equiv="refresh" content="0; url={first}">'
    (site / "index.html").write_text(f'{head}\n<a href="{first}">gsbridge {names[0]}</a>\n', encoding="utf-8")


def on_files(files: Any, config: Any) -> Any:
    """Add the pages of the root."""
    from mkdocs.structure.files import File

    for source, target in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, target, content=moved_links(text, source, target)))
    for source in OTHERS:
        files.append(File.generated(config, source, content=(ROOT / source).read_bytes()))
    return files


def moved_links(text: str, source: str, target: str) -> str:
    """A page of the root with its links as they are in the site, where `docs/` is the root."""
    depth = target.count("/")

    def moved(found: re.Match[str]) -> str:
        file, mark, anchor = found[2].partition("#")
        whole = posixpath.normpath(posixpath.join(posixpath.dirname(source), file))
        place = PAGES.get(whole, whole.removeprefix("docs/"))
        return found[1] + "../" * depth + place + mark + anchor + found[3]

    return _LINK.sub(moved, text)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Text and code within numbered items is indented by three spaces; Python's Markdown wants four."""
    out, inside = [], False
    for line in markdown.split("\n"):
        inside = bool(_ITEM.match(line)) or (inside and (not line or line.startswith("   ")))
        out.append(f" {line}" if inside and line.startswith("   ") else line)
    return "\n".join(out)
