"""Threads of a scene's jobs."""

import pytest

from gsbridge.experiment.threads import VARIABLE, scene_threads

MUG = "results/scenes/mug/splats/soft/splats.json"
CUP = "./results/scenes/cup/mesh/mesh.json"


@pytest.mark.parametrize(
    ("cores", "arguments", "threads"),
    [
        (2, [MUG], 2),
        (8, ["--cores", "8", MUG, "results/scenes/mug/asset/asset.json"], 8),
        (8, [MUG, CUP], 4),
        (2, [], 1),
        (8, [], 2),
        (8, [MUG, "results/tables"], 2),
        (2, ["--config", "preset=toy"], 1),
        (None, [MUG], 1),
    ],
)
def test_cores_are_shared_by_the_scenes_that_run(cores, arguments, threads, monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    assert scene_threads(cores, arguments, ["mug", "cup", "bear"]) == threads


def test_a_person_or_the_main_process_decides(monkeypatch):
    monkeypatch.setenv(VARIABLE, "3")
    assert scene_threads(8, [MUG], ["mug"]) == 3
