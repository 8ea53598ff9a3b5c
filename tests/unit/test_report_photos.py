"""Figures of real things: against meshes, cameras and records whose figures are known."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from gsbridge.cameras import Camera, View, write_views
from gsbridge.configuration.whole import Recipe, read_configuration
from gsbridge.errors import InputError
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.report.scores.measured_photos import (
    Reference,
    compared,
    length_errors,
    opening_depth,
    photo_figures,
    read_references,
    write_photo_figures,
)
from gsbridge.report.scores.turned import Reconstruction
from gsbridge.splats.degree import degree_of_photos

ROOT = Path(__file__).resolve().parents[2]
CAMERA = Camera(640, 480, 600.0, 600.0, 320.0, 240.0)
HEIGHT = 0.5


def _standing(solid: trimesh.Trimesh, scale: float = 1.0) -> Mesh:
    solid.apply_translation([0, 0, -solid.bounds[0, 2]])
    return Mesh(scale * np.asarray(solid.vertices, dtype=float), np.asarray(solid.faces))


def _cup(drain: float = 0.0) -> trimesh.Trimesh:
    """A cup 56 mm high and 50 mm deep, with a round hole of this radius in its floor, m."""
    wall = trimesh.creation.annulus(0.03, 0.04, 0.056)
    wall.apply_translation([0, 0, 0.028])
    disc = trimesh.creation.annulus(drain, 0.035, 0.006) if drain else trimesh.creation.cylinder(0.035, 0.006)
    disc.apply_translation([0, 0, 0.003])
    return trimesh.util.concatenate([wall, disc])


def _reconstruction() -> Reconstruction:
    statuses = dict.fromkeys(("sfm", "align", "masks", "mesh"), "pass")
    return Reconstruction(statuses, {stage: [] for stage in statuses}, "known_length", 50, [0.05, 0.08, 0.1], 3e-4, 3.1e-4)


@pytest.fixture
def scene(tmp_path):
    """Write a scene seen from straight above: `mesh`, status of align and mesh, and PSNRs of the trainings."""

    def write(
        mesh,
        *,
        align="pass",
        surface="pass",
        soft=(30.0, 31.0),
        games=(29.0, 30.5),
        vertices=(30.5, 32.5),
        recipe=33.0,
        refined=31.5,
    ):
        folder = tmp_path / f"scene{len(list(tmp_path.iterdir()))}"
        (folder / "images").mkdir(parents=True)
        (folder / "images/a.png").write_bytes(b"")
        looking_down = np.diag([1.0, -1.0, -1.0, 1.0])
        looking_down[2, 3] = HEIGHT
        write_views(folder / "views.json", [View("a.png", CAMERA, looking_down)])
        content = {
            "sfm": {"status": "pass", "camera": CAMERA.to_json()},
            "align": {"status": align},
            "mesh": {"status": surface},
        }
        for name, value in content.items():
            (folder / f"{name}.json").write_text(json.dumps(value))
        for name in ("visual", "collision"):
            write_mesh(folder / f"{name}.ply", mesh)
        records = {name: str(folder / f"{name}.json") for name in (*content, "views")}
        records |= {"images": str(folder / "images"), "visual": str(folder / "visual.ply")}
        records |= {"collision": str(folder / "collision.ply")}
        for binding, psnrs in (("soft", soft), ("games", games), ("games_vertices", vertices)):
            paths = []
            for seed, psnr in enumerate(psnrs):
                paths.append(folder / f"{binding}{seed}.json")
                paths[-1].write_text(json.dumps({"metrics": {"held_out": {"masked": {"psnr": psnr}}}}))
            records[binding] = [str(path) for path in paths]
        for training, psnr in (("recipe", recipe), ("refined", refined)):
            path = folder / f"{training}.json"
            path.write_text(json.dumps({"metrics": {"held_out": {"masked": {"psnr": psnr}}}}))
            records[training] = str(path)
        # Turned photos come out as the others.
        found = asdict(_reconstruction())
        records["turned"] = []
        for degrees in (0, 90, 180, 270):
            path = folder / f"{degrees}.json"
            path.write_text(json.dumps({"degrees": degrees, "usual": found, "turned": found, "refused": None}))
            records["turned"].append(str(path))
        return records

    return write


def _length(metres: float, pixels: float, name: str = "a.png") -> dict[str, object]:
    """A length along the picture's rows."""
    ends = [["a.png", 320 - pixels / 2, 240.0], [name, 320 + pixels / 2, 240.0]]
    return {"metres": metres, "between": ends, "marks": "two dots"}


def _known(**known: object) -> Reference:
    return Reference.model_validate({"source": "us", **known})


def test_a_length_is_read_on_the_table(scene):
    # From half a metre with 600 px of focal length, 120 px are 0.1 m.
    records = scene(_standing(_cup()))
    lengths = _known(lengths=[_length(0.1, 120), _length(0.1, 126), _length(0.1, 120, "b.png")]).lengths
    assert length_errors(lengths[:2], records) == pytest.approx([0.0, 5.0], abs=1e-6)
    with pytest.raises(InputError, match=r"b\.png is not registered"):
        length_errors(lengths, records)


def test_an_opening_is_as_deep_with_a_hole_in_its_floor():
    assert opening_depth(_standing(_cup())) == pytest.approx(0.050, abs=1e-6)
    assert opening_depth(_standing(_cup(drain=0.003))) == pytest.approx(0.050, abs=1e-6)
    assert opening_depth(_standing(trimesh.creation.cylinder(0.04, 0.056))) == pytest.approx(0, abs=1e-6)


def test_a_filled_cup_that_passes_is_wrong(scene):
    reference = _known(top_m=0.056, opening_m=0.045, lengths=[_length(0.1, 120)])
    good = compared(reference, scene(_standing(_cup())))
    assert good.scale_percent == pytest.approx(0, abs=1e-6)
    assert good.top_mm == pytest.approx(0, abs=1e-3)
    assert good.opening_mm == pytest.approx(50, abs=1e-3)
    assert not good.wrong_and_pass
    filled = _standing(trimesh.creation.cylinder(0.04, 0.056))
    assert compared(reference, scene(filled)).wrong_and_pass
    assert not compared(reference, scene(filled, surface="degraded")).wrong_and_pass
    tall = compared(reference, scene(_standing(_cup(), scale=1.15)))
    assert tall.top_mm == pytest.approx(0.15 * 56, abs=0.01)
    assert tall.wrong_and_pass


def test_a_wrong_scale_that_passes_is_wrong(scene):
    reference = _known(lengths=[_length(0.1, 132)])
    assert compared(reference, scene(_standing(_cup()))).wrong_and_pass
    assert not compared(reference, scene(_standing(_cup()), align="degraded")).wrong_and_pass
    assert compared(reference, scene(_standing(_cup()))).top_mm is None


def test_figures_of_two_things(scene):
    scenes = {
        "pot": scene(_standing(_cup())),
        "apple": scene(
            _standing(trimesh.creation.icosphere(radius=0.04)),
            soft=(28.0, 28.0),
            games=(28.5, 28.5),
            vertices=(28.0, 28.0),
            recipe=28.4,
        ),
    }
    found = photo_figures(scenes, {"pot": _known(opening_m=0.03)})
    assert found["photos_soft_minus_games_min"]["by_scene"] == {"pot": 0.75, "apple": -0.5}
    assert (found["photos_soft_minus_games_min"]["value"], found["photos_soft_minus_games_min"]["seeds"]) == (-0.5, 2)
    assert found["photos_soft_minus_games_mean"]["value"] == pytest.approx(0.125)
    assert found["photos_soft_minus_games_vertices_mean"]["by_scene"] == {"pot": -1.0, "apple": 0.0}
    assert found["photos_refined_minus_games_vertices_mean"]["by_scene"] == {"pot": 1.0, "apple": 3.5}
    assert found["photos_soft_psnr_min"]["value"] == 28.0
    assert found["photos_recipe_gain_mean"]["value"] == pytest.approx((3.0 + 0.4) / 2)
    assert found["pot_recipe_psnr"]["value"] == 33.0
    assert found["photos_opening_min"]["value"] == pytest.approx(50, abs=1e-3)
    assert "photos_scale_error_max" not in found
    assert (found["photos_wrong_and_pass"]["value"], found["photos_wrong_and_pass"]["n"]) == (0, 1)
    assert (found["photos_turns_different"]["value"], found["photos_turns_different"]["turns"]) == (0, 6)
    assert photo_figures({}, {"pot": _known(opening_m=0.03)}) == {}


def test_the_recipe_is_that_of_the_guide():
    text = (ROOT / "docs/splats.md").read_text()
    quality = text[text.index("## Quality") :]
    block = quality[quality.index("```yaml") + len("```yaml") : quality.index("```", quality.index("```yaml") + 3)]
    # Of a film of usual length; the recipe itself takes the degree that the photos determine.
    assert yaml.safe_load(block) == {"object_splats": Recipe().model_dump() | {"sh_degree": degree_of_photos(44)}}
    fewest = {degree: min(n for n in range(100) if degree_of_photos(n) == degree) for degree in range(4)}
    assert fewest == {0: 0, 1: 8, 2: 18, 3: 32}


@pytest.mark.parametrize(
    ("entry", "wrong"),
    [
        ({"source": "us", "top_mm": 58}, "top_mm"),
        ({"source": "us", "top_m": "high"}, "top_m"),
        ({"source": "us", "lengths": [{"metres": 0, "between": [["a", 1, 1], ["a", 2, 2]], "marks": "?"}]}, "metres"),
        ({"source": "us", "lengths": [{"metres": 0.1, "between": [["a", 1, 1]], "marks": "?"}]}, "between"),
        ({}, "source"),
    ],
)
def test_wrong_references_are_named(tmp_path, entry, wrong):
    path = tmp_path / "photos.json"
    path.write_text(json.dumps({"pot": entry}))
    with pytest.raises(InputError, match=rf"photos\.json: pot.*{wrong}"):
        write_photo_figures(tmp_path / "out.json", scenes={}, references=path)
    assert not (tmp_path / "out.json").exists()


def test_references_name_scenes_that_are_scored():
    config = read_configuration(yaml.safe_load((ROOT / "config.yaml").read_text()))
    references = read_references(ROOT / "benchmarks/photos.json")
    assert set(references) <= set(config["photos"])
    for name, reference in references.items():
        gave = config["scenes"][name]["known_length"]["between"]
        # The length that gave the scale, with its ends in either order, would agree with itself.
        seen = {frozenset(map(tuple, length.between)) for length in reference.lengths}
        assert frozenset(map(tuple, gave)) not in seen
