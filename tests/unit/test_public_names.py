"""What other programs import from `gsbridge`: every name is there and documented, and the import alone costs nothing."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import gsbridge

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", [name for name in gsbridge.__all__ if name != "__version__"])
def test_every_name_is_there_and_says_what_it_is(name):
    found = getattr(gsbridge, name)
    assert found.__module__.startswith("gsbridge.")
    assert found.__doc__


def test_names_of_the_type_checker_are_those_at_run_time():
    text = (ROOT / "gsbridge" / "__init__.py").read_text()
    checked = re.findall(r"from gsbridge\.([\w.]+) import ([\w, ]+)", text)
    assert {home: tuple(names.split(", ")) for home, names in checked} == gsbridge._HOMES
    assert sorted(name for names in gsbridge._HOMES.values() for name in names) == sorted(
        set(gsbridge.__all__) - {"__version__"}
    )


def test_other_names_are_refused():
    with pytest.raises(AttributeError, match="has no attribute 'rasterise'"):
        gsbridge.rasterise  # noqa: B018


def test_the_import_loads_no_other_library():
    code = "import sys, gsbridge; print(sorted({'numpy', 'torch', 'cv2', 'numba', 'pydantic'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def test_the_examples_run_as_they_stand(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / "docs" / "library.md").read_text(), re.DOTALL | re.MULTILINE)
    assert len(blocks) == 3
    names = {}
    for block in blocks:
        exec(compile(block, "docs/library.md", "exec"), names)
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("torch.Size([120, 160, 3])")
    assert said[1] == "base [('hinge', 'revolute', -1.0, 1.0)]"
    assert said[2].startswith("axis.urdf: ")
    assert float(names["image"].alphas.max()) > 0.7
