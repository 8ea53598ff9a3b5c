"""Figures of real things: against meshes, cameras and records whose figures are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from gsbridge.cameras import Camera, View, write_views
from gsbridge.errors import InputError
from gsbridge.experiment.plan import RECIPE
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.report.scores.measured_photos import compared, length_errors, photo_figures

ROOT = Path(__file__).resolve().parents[2]
CAMERA = Camera(640, 480, 600.0, 600.0, 320.0, 240.0)
HEIGHT = 0.5


def _standing(solid: trimesh.Trimesh, scale: float = 1.0) -> Mesh:
    solid.apply_translation([0, 0, -solid.bounds[0, 2]])
    return Mesh(scale * np.asarray(solid.vertices, dtype=float), np.asarray(solid.faces))


def _cup() -> trimesh.Trimesh:
    wall = trimesh.creation.annulus(0.03, 0.04, 0.056)
    wall.apply_translation([0, 0, 0.028])
    disc = trimesh.creation.cylinder(0.035, 0.006)
    disc.apply_translation([0, 0, 0.003])
    return trimesh.util.concatenate([wall, disc])


@pytest.fixture
def scene(tmp_path):
    """Write a scene seen from straight above: `mesh`, status of align and mesh, and PSNRs of the trainings."""

    def write(mesh, *, align="pass", surface="pass", soft=(30.0, 31.0), games=(29.0, 30.5), recipe=33.0):
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
        for binding, psnrs in (("soft", soft), ("games", games), ("recipe", (recipe,))):
            paths = []
            for seed, psnr in enumerate(psnrs):
                paths.append(folder / f"{binding}{seed}.json")
                paths[-1].write_text(json.dumps({"metrics": {"held_out": {"masked": {"psnr": psnr}}}}))
            records[binding] = [str(path) for path in paths] if binding != "recipe" else str(paths[0])
        return records

    return write


def _length(metres: float, pixels: float) -> dict[str, object]:
    """A length along the picture's rows."""
    return {"metres": metres, "between": [["a.png", 320 - pixels / 2, 240.0], ["a.png", 320 + pixels / 2, 240.0]]}


def test_a_length_is_read_on_the_table(scene):
    # From half a metre with 600 px of focal length, 120 px are 0.1 m.
    records = scene(_standing(_cup()))
    assert length_errors([_length(0.1, 120), _length(0.1, 126)], records) == pytest.approx([0.0, 5.0], abs=1e-6)
    with pytest.raises(InputError, match=r"b\.png of a reference is not registered"):
        length_errors([{"metres": 0.1, "between": [["a.png", 1, 1], ["b.png", 1, 1]]}], records)


def test_a_filled_cup_that_passes_is_wrong(scene):
    reference = {"top_m": 0.056, "hollow": True, "lengths": [_length(0.1, 120)]}
    good = compared(reference, scene(_standing(_cup())))
    assert good.scale_percent == pytest.approx(0, abs=1e-6)
    assert good.top_mm == pytest.approx(0, abs=1e-3)
    assert good.cavity_mm == pytest.approx(50, abs=0.2)
    assert not good.wrong_and_pass
    filled = _standing(trimesh.creation.cylinder(0.04, 0.056))
    assert compared(reference, scene(filled)).wrong_and_pass
    assert not compared(reference, scene(filled, surface="degraded")).wrong_and_pass
    tall = compared(reference, scene(_standing(_cup(), scale=1.15)))
    assert tall.top_mm == pytest.approx(0.15 * 56, abs=0.01)
    assert tall.wrong_and_pass


def test_a_wrong_scale_that_passes_is_wrong(scene):
    reference = {"lengths": [_length(0.1, 132)]}
    assert compared(reference, scene(_standing(_cup()))).wrong_and_pass
    assert not compared(reference, scene(_standing(_cup()), align="degraded")).wrong_and_pass
    assert compared(reference, scene(_standing(_cup()))).top_mm is None


def test_figures_of_two_things(scene):
    scenes = {
        "pot": scene(_standing(_cup())),
        "apple": scene(_standing(trimesh.creation.icosphere(radius=0.04)), soft=(28.0, 28.0), games=(28.5, 28.5), recipe=28.4),
    }
    found = photo_figures(scenes, {"pot": {"hollow": True}})
    assert found["photos_soft_minus_games_min"]["by_scene"] == {"pot": 0.75, "apple": -0.5}
    assert (found["photos_soft_minus_games_min"]["value"], found["photos_soft_minus_games_min"]["seeds"]) == (-0.5, 2)
    assert found["photos_soft_minus_games_mean"]["value"] == pytest.approx(0.125)
    assert found["photos_soft_psnr_min"]["value"] == 28.0
    assert found["photos_recipe_gain_mean"]["value"] == pytest.approx((3.0 + 0.4) / 2)
    assert found["pot_recipe_psnr"]["value"] == 33.0
    assert found["photos_cavity_min"]["value"] == pytest.approx(50, abs=0.2)
    assert "photos_scale_error_max" not in found
    assert (found["photos_wrong_and_pass"]["value"], found["photos_wrong_and_pass"]["n"]) == (0, 1)
    assert photo_figures({}, {"pot": {"hollow": True}}) == {}


def test_the_recipe_is_that_of_the_guide():
    text = (ROOT / "docs/splats.md").read_text()
    quality = text[text.index("## Quality") :]
    block = quality[quality.index("```yaml") + len("```yaml") : quality.index("```", quality.index("```yaml") + 3)]
    assert yaml.safe_load(block) == {"object_splats": RECIPE}


def test_references_name_scenes_that_are_scored():
    config = yaml.safe_load((ROOT / "config.yaml").read_text())
    references = json.loads((ROOT / "benchmarks/photos.json").read_text())
    assert set(references) <= set(config["photos"])
    for name, reference in references.items():
        gave = config["scenes"][name]["known_length"]["between"]
        # The length that gave the scale would agree with itself.
        assert all(length["between"] != gave for length in reference["lengths"])
