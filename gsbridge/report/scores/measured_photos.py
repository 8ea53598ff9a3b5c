"""Figures of the area `photos`: real things, photographed by others.

No true mesh is known of them. What is known, such as the length between two printed marks, is read from a file of references.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.align.length import table_point
from gsbridge.cameras import Camera, read_views
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.meshes import read_mesh
from gsbridge.photogrammetry.cavity import cavity_depth
from gsbridge.report.scores.score import Figure, over_scenes, single, write_measured
from gsbridge.report.scores.shape import WRONG_M

_WHERE = "results/scenes/"
_WRONG_SCALE_PERCENT = 5.0
"""A scale that is off by more than this is wrong, percent."""

Records = Mapping[str, Any]
"""Paths of a scene's records by name, as `gsbridge.experiment.plan.Experiment.photo_records` gives them."""


def masked_psnrs(records: Sequence[str | Path]) -> list[float]:
    """PSNR on held-out photos inside the mask of each training, dB.

    Args:
        records: `splats.json` of each training.

    Raises:
        InputError: A record is damaged.
    """
    found = []
    for path in records:
        try:
            found.append(float(read_json(path)["metrics"]["held_out"]["masked"]["psnr"]))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(path, f"it has no PSNR of held-out photos ({error!r})", "Train the splats again") from error
    return found


def length_errors(lengths: Sequence[Mapping[str, Any]], records: Records) -> list[float]:
    """Errors of the reconstruction's scale by lengths on the table that gave no scale, percent.

    Args:
        lengths: Reference lengths: `metres`, and `between`, two points as [photo, u, v] in pixels of the keyframes.
        records: Paths of the scene's records.

    Raises:
        InputError: A photo of a reference is not registered.
    """
    record = read_json(records["sfm"])
    taken = Camera.from_json(record["camera"])
    others = {name: Camera.from_json(item) for name, item in record.get("other_cameras", {}).items()}
    poses = {view.name: view.cam_from_table for view in read_views(records["views"], records["images"])}
    out = []
    for length in lengths:
        ends = []
        for name, u, v in length["between"]:
            if name not in poses:
                raise InputError(records["views"], f"the photo {name} of a reference is not registered", "Name another photo")
            ends.append(table_point(np.array([u, v]), others.get(name, taken), poses[name]))
        out.append(100.0 * (float(np.linalg.norm(ends[1] - ends[0])) / float(length["metres"]) - 1.0))
    return out


@dataclass(frozen=True)
class Known:
    """What is known of a thing, compared with its reconstruction.

    Args:
        scale_percent: Largest error of a length that did not give the scale; None where none is known.
        top_mm: Largest distance of the top of a mesh from the true top; None where that is not known.
        cavity_mm: Depth of the opening, the shallower of both meshes; None for a solid thing.
        wrong_and_pass: Whether the scale or a mesh is wrong although its stage says `pass`.
    """

    scale_percent: float | None
    top_mm: float | None
    cavity_mm: float | None
    wrong_and_pass: bool


def compared(reference: Mapping[str, Any], records: Records) -> Known:
    """Compare a reconstruction with what is known of the thing.

    Args:
        reference: `lengths` (see `length_errors`); `top_m`, height of the highest point above the table, m; `hollow`. Each may
            be absent.
        records: Paths of the scene's records.

    Raises:
        InputError: A record is damaged.
    """
    meshes = [read_mesh(records[name]) for name in ("visual", "collision")]
    lengths, top = reference.get("lengths"), reference.get("top_m")
    scale = max(map(abs, length_errors(lengths, records))) if lengths else None
    high = 1e3 * max(abs(float(mesh.vertices[:, 2].max()) - top) for mesh in meshes) if top is not None else None
    depth = 1e3 * min(map(cavity_depth, meshes)) if reference.get("hollow") else None
    wrong = {
        "align": scale is not None and scale > _WRONG_SCALE_PERCENT,
        "mesh": (high is not None and high > 1e3 * WRONG_M) or depth == 0,
    }
    passed = [stage for stage in wrong if read_json(records[stage])["status"] == "pass"]
    return Known(scale, high, depth, any(wrong[stage] for stage in passed))


def splat_figures(scenes: Mapping[str, Records]) -> dict[str, Figure]:
    """Make the figures of the splats, masked, on held-out photos.

    Args:
        scenes: Records of each scene.

    Raises:
        InputError: A record is damaged.
    """
    soft = {name: masked_psnrs(records["soft"]) for name, records in scenes.items()}
    games = {name: masked_psnrs(records["games"]) for name, records in scenes.items()}
    recipe = {name: masked_psnrs([records["recipe"]])[0] for name, records in scenes.items()}
    if not scenes:
        return {}
    leads = {name: [a - b for a, b in zip(soft[name], games[name], strict=True)] for name in scenes}
    means = {name: statistics.fmean(lead) for name, lead in leads.items()}
    seeds = min(map(len, leads.values()))
    mean = {name: statistics.fmean(found) for name, found in soft.items()}
    # The recipe is trained with the first seed.
    gains = {name: recipe[name] - soft[name][0] for name in scenes}
    return {
        "photos_soft_minus_games_min": over_scenes(means, min, _WHERE, seeds=seeds, by_scene_and_seed=leads),
        "photos_soft_minus_games_mean": over_scenes(means, statistics.fmean, _WHERE, seeds=seeds),
        "photos_soft_psnr_min": over_scenes(mean, min, _WHERE, seeds=seeds),
        "photos_recipe_gain_mean": over_scenes(gains, statistics.fmean, _WHERE),
        **{f"{name}_recipe_psnr": single(psnr, 1, f"{_WHERE}{name}/recipe/") for name, psnr in recipe.items()},
    }


def photo_figures(scenes: Mapping[str, Records], references: Mapping[str, Mapping[str, Any]]) -> dict[str, Figure]:
    """Make the figures of all scenes.

    Args:
        scenes: Records of each scene.
        references: What is known of a scene, by name, see `compared`.

    Raises:
        InputError: A record is damaged.
    """
    known = {name: compared(references[name], records) for name, records in scenes.items() if name in references}
    out = splat_figures(scenes)
    for figure, key, summary in (
        ("photos_scale_error_max", "scale_percent", max),
        ("photos_top_error_max", "top_mm", max),
        ("photos_cavity_min", "cavity_mm", min),
    ):
        found = {name: getattr(item, key) for name, item in known.items() if getattr(item, key) is not None}
        if found:
            out[figure] = over_scenes(found, summary, _WHERE)
    if known:
        wrong = {name: float(item.wrong_and_pass) for name, item in known.items()}
        out["photos_wrong_and_pass"] = single(sum(wrong.values()), len(wrong), _WHERE) | {"by_scene": wrong}
    return out


def write_photo_figures(
    out: str | Path, *, scenes: Mapping[str, Records], references: str | Path, preset: str | None = None
) -> None:
    """Gather all figures of the area and write them.

    Args:
        out: JSON of measured figures, an input of `score.write_scores`.
        scenes: Records of each scene.
        references: `benchmarks/photos.json`, see `photo_figures`.
        preset: Preset that ran.

    Raises:
        InputError: A file is damaged.
    """
    write_measured(out, preset, lambda: photo_figures(scenes, read_json(references)), damaged="the records of a capture are")
