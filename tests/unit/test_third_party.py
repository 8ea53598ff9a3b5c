"""The page of licences names every package of the lock, as its metadata state it."""

import importlib.util
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def program():
    spec = importlib.util.spec_from_file_location("third_party", ROOT / ".ci" / "third_party.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_what_the_program_writes():
    assert (ROOT / "THIRD_PARTY.md").read_text() == program().page(), "run: python .ci/third_party.py"


def test_every_locked_package_is_on_it_and_the_gpl_is_told():
    text = (ROOT / "THIRD_PARTY.md").read_text()
    rows = dict(re.findall(r"^\| (\S+) \| (\S+) \| .+ \|$", text, re.MULTILINE))
    assert {name: version for name, version in rows.items() if name != "package"} == program().locked()
    assert "pymeshlab stands under the General Public License" in text
    assert "rerun analytics disable" in text
