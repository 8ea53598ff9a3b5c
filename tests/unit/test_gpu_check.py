"""The check of a GPU: what it says where there is none, and that its rehearsal runs on the CPU."""

import subprocess
from pathlib import Path

import pytest
import torch

from benchmarks.gpu_check import Check, Line, main
from gsbridge.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


def test_without_a_gpu_it_says_so_and_what_to_do(capsys):
    if torch.cuda.is_available():
        pytest.skip("there is one")
    assert main([]) == 1
    said = capsys.readouterr().out
    assert said.count("\n") == 1
    assert "nothing was checked" in said
    assert "make setup TORCH_INDEX=" in said


def test_parity_and_policy_are_measured_on_the_cpu():
    """Against the reference in plain torch and against itself."""
    check = Check("cpu", Path("none"))
    lines = check.parity() + check.policy()
    assert [line.kept for line in lines] == [True] * 7 + [None]
    assert [line.name.split()[0] for line in lines] == ["forward,", *["gradient"] * 5, "policy,", "policy,"]


def test_what_cannot_be_measured_or_breaks_is_a_line_and_does_not_stop_the_rest(tmp_path):
    check = Check("cpu", tmp_path)

    def damaged() -> list[Line]:
        raise RuntimeError("device-side assert")

    check.run("object", check.paper_object)
    check.run("broken", damaged)
    check.run("stereo", check.dense_stereo)
    assert check.lines[0].value.endswith("Run `make toy` first")
    assert check.lines[0].kept is None
    assert check.lines[1] == Line("broken", "failed: RuntimeError: device-side assert", "", False)
    assert "pycolmap" in check.lines[2].value


def test_the_scene_is_asked_for_by_name(tmp_path):
    with pytest.raises(InputError, match="small_cube"):
        Check("cpu", tmp_path).paper_object()


def test_make_has_the_target():
    said = subprocess.run(["make", "--dry-run", "gpu-check"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert "-m benchmarks.gpu_check" in said
