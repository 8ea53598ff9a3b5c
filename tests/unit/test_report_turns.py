"""What a quarter turn of the photos changes: against reconstructions whose differences are known."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import trimesh

from gsbridge.errors import InputError
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.report.scores.measured_turns import differences, says_the_same, turn_figures
from gsbridge.report.scores.turned import STAGES, Reconstruction

USUAL = Reconstruction(
    dict.fromkeys(STAGES, "pass"), {stage: [] for stage in STAGES}, "known_length", 50, [0.05, 0.08, 0.1], 3e-4, 3.1e-4
)


@pytest.fixture
def records(tmp_path):
    """Write a scene's records: each turn, and 0 degrees with another seed, comes out as usual unless it is given."""

    def write(name="pot", usual=USUAL, **given):
        paths = []
        for degrees in (0, 90, 180, 270):
            item = given.get(f"t{degrees}", usual)
            path = tmp_path / f"{name}-{degrees}.json"
            turned = None if item is None else asdict(item)
            path.write_text(json.dumps({"degrees": degrees, "usual": asdict(usual), "turned": turned, "refused": None}))
            paths.append(str(path))
        return paths

    return write


def _higher(percent, usual=USUAL):
    """The same thing, this much higher, of the same volume."""
    return replace(usual, sides=[*usual.sides[:2], usual.sides[2] * (1 + percent / 100)])


def _count(paths):
    return turn_figures({"pot": paths})["photos_turns_different"]["value"]


def test_the_same_thing_comes_out_of_all_turns(records):
    found = turn_figures({"pot": records(), "apple": records("apple")})
    count = found["photos_turns_different"]
    assert (count["value"], count["n"], count["turns"]) == (0, 2, 6)
    assert found["photos_turned_sides_max"]["value"] == found["photos_turned_volume_max"]["value"] == 0
    assert turn_figures({}) == {}


def test_a_mesh_may_change_as_little_as_another_seed_changes_it(records):
    assert _count(records(t90=_higher(0.9))) == 0
    assert _count(records(t90=_higher(1.5))) == 1
    assert _count(records(t90=_higher(1.5), t0=_higher(0.8))) == 0
    # However much another seed changes, 3 % is the most.
    assert _count(records(t90=_higher(3.5), t180=_higher(2.9), t0=_higher(20))) == 1
    found = turn_figures({"pot": records(t90=_higher(1.5), t0=_higher(0.8))})["photos_turned_sides_max"]
    assert found["by_scene"]["pot"] == pytest.approx(1.5)
    assert found["beside"]["another seed, not turned"]["pot"] == pytest.approx(0.8)


@pytest.mark.parametrize("again", [None, replace(_higher(9), registered=20)])
def test_a_run_with_another_seed_that_fails_allows_nothing(records, again):
    assert _count(records(t90=_higher(1.5), t0=again)) == 1
    assert turn_figures({"pot": records(t0=again)})["photos_turned_sides_max"]["beside"] is None


def test_a_cavity_that_a_turn_fills_is_seen_in_the_volume(records):
    filled = replace(USUAL, visual_volume=1.5 * USUAL.visual_volume)
    assert _count(records(t180=filled)) == 1
    assert _count(records(t180=replace(USUAL, collision_volume=0.9 * USUAL.collision_volume))) == 1
    assert differences(USUAL, filled) == {"sides": 0, "volume": pytest.approx(50)}


@pytest.mark.parametrize(
    "change",
    [
        {"statuses": {**USUAL.statuses, "mesh": "degraded"}},
        {"reasons": {**USUAL.reasons, "mesh": ["the mesh may be wrong"]}},
        {"scale_source": "unknown"},
        {"registered": 48},
        {"registered": 52},
    ],
)
def test_a_turn_differs_by_what_stages_say_too(records, change):
    assert _count(records(t270=replace(USUAL, **change))) == 1


def test_numbers_and_photos_in_reasons_do_not_count():
    def doubting(text):
        return replace(USUAL, reasons={**USUAL.reasons, "sfm": [text]})

    assert says_the_same(doubting("7 of 50 photos, 0012.png worst"), doubting("8 of 50 photos, 0031.png worst"))
    assert not says_the_same(doubting("7 of 50 photos"), doubting("7 of 50 points"))
    assert says_the_same(USUAL, replace(USUAL, registered=51))


def test_refused_turns_differ_and_hide_no_others(records):
    found = turn_figures({"pot": records(t90=None, t180=_higher(2.0))})
    assert found["photos_turns_different"]["by_scene"]["pot"] == 2
    assert found["photos_turns_different"]["beside"]["refused"]["pot"] == 1
    assert found["photos_turned_sides_max"]["value"] == pytest.approx(2.0)
    assert "photos_turned_sides_max" not in turn_figures({"pot": records(t90=None, t180=None, t270=None)})


def test_without_a_scale_only_shapes_are_compared():
    unknown = replace(USUAL, scale_source="unknown")
    twice = replace(unknown, sides=[2 * side for side in USUAL.sides], visual_volume=8 * 3e-4, collision_volume=8 * 3.1e-4)
    assert differences(unknown, twice) == {"sides": pytest.approx(0), "volume": pytest.approx(0)}
    assert differences(USUAL, replace(twice, scale_source="known_length"))["sides"] == pytest.approx(100)
    assert differences(unknown, _higher(1.5, unknown))["sides"] == pytest.approx(1.5)


def test_a_reconstruction_is_read_from_its_files(tmp_path):
    solid = trimesh.creation.box((0.08, 0.05, 0.1))
    solid.apply_translation([0, 0, 0.05])
    paths = {stage: tmp_path / f"{stage}.json" for stage in STAGES}
    for stage, path in paths.items():
        path.write_text(json.dumps({"status": "pass", "reasons": [stage], "registered": 12, "scale_source": "tags"}))
    for name in ("visual", "collision"):
        paths[name] = tmp_path / f"{name}.ply"
        write_mesh(paths[name], Mesh(np.asarray(solid.vertices), np.asarray(solid.faces)))
    found = Reconstruction.read(paths)
    assert (found.registered, found.scale_source, found.reasons["masks"]) == (12, "tags", ["masks"])
    assert found.sides == pytest.approx([0.05, 0.08, 0.1])
    assert (found.visual_volume, found.collision_volume) == pytest.approx((4e-4, 4e-4))


def test_a_damaged_record_is_named(tmp_path, records):
    paths = records()
    (tmp_path / "pot-180.json").write_text(json.dumps({"degrees": 180, "usual": asdict(USUAL), "turned": {"sides": 1}}))
    with pytest.raises(InputError, match=r"pot-180\.json: it is no record of turned photos"):
        turn_figures({"pot": paths})
