"""The documentation's site: every page stands in its menu once, and pages of the root find their way in it."""

import importlib.util
import json
import re
import types
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
SITE = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
_SPEC = importlib.util.spec_from_file_location("site_pages", ROOT / "docs/site_pages.py")
hooks = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(hooks)


def named(entries):
    """Pages of a menu, whatever their depth."""
    for entry in entries:
        for value in entry.values():
            if isinstance(value, str):
                yield value
            else:
                yield from named(value)


def test_every_page_stands_in_the_menu_once():
    menu = list(named(SITE["nav"]))
    assert sorted(menu) == sorted({*hooks.PAGES.values(), *(page.name for page in (ROOT / "docs").glob("*.md"))})


def test_links_of_the_root_s_pages_lead_to_pages_of_the_site():
    there = {*hooks.PAGES.values(), *hooks.OTHERS}
    there |= {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*") if path.is_file()}
    for source, target in hooks.PAGES.items():
        text = hooks.moved_links((ROOT / source).read_text(encoding="utf-8"), source, target)
        text = re.sub(r"^ *```.*?^ *```|`[^`\n]*`", "", text, flags=re.DOTALL | re.MULTILINE)
        for link in re.findall(r"\]\((?!https?:|mailto:|#)([^()\s]+)\)", text):
            place = (Path(target).parent / link.partition("#")[0]).as_posix()
            place = re.sub(r"^(?:benchmarks/)?\.\./", "", place)
            assert place in there, f"{source}: {link}"


def test_links_and_lists_are_rewritten_as_they_should():
    text = "See [a](docs/gap.md#how), [b](CONTRIBUTING.md), [c](https://x.org/docs/y), ![d](docs/pictures/e.jpg)."
    moved = "See [a](gap.md#how), [b](CONTRIBUTING.md), [c](https://x.org/docs/y), ![d](pictures/e.jpg)."
    assert hooks.moved_links(text, "README.md", "index.md") == moved
    assert hooks.moved_links("[r](../README.md)", "benchmarks/RESULTS.md", "benchmarks/RESULTS.md").endswith("index.md)")
    assert hooks.on_page_markdown("1. one\n\n   ```sh\n   a\n   ```\n\n   later\n2. two\n\nend\n   x") == (
        "1. one\n\n    ```sh\n    a\n    ```\n\n    later\n2. two\n\nend\n   x"
    )


def test_versions_lie_side_by_side_and_the_site_begins_with_the_newest(tmp_path):
    for name in ("0.9.0", "0.10.0", hooks.version()):
        (tmp_path / name).mkdir()
        (tmp_path / name / "index.html").write_text("")
    (tmp_path / "unfinished").mkdir()
    hooks.on_post_build(types.SimpleNamespace(site_dir=str(tmp_path / hooks.version())))
    listed = json.loads((tmp_path / "versions.json").read_text())
    assert [entry["version"] for entry in listed] == ["0.10.0", "0.9.0", hooks.version()]
    assert [entry["aliases"] for entry in listed] == [["latest"], [], []]
    assert "url=0.10.0/index.html" in (tmp_path / "index.html").read_text()


def test_a_version_has_a_folder_of_its_own_unless_pages_are_only_shown():
    config = types.SimpleNamespace(site_dir=str(ROOT / SITE["site_dir"]))
    assert hooks.on_config(config).site_dir == str(ROOT / "site" / hooks.version())
    assert hooks.on_config(types.SimpleNamespace(site_dir="/elsewhere")).site_dir == "/elsewhere"
