"""Figures of the area `photos`: real things, photographed by others.

No true mesh is known of them. What is known, such as lengths that are printed on one sheet, is read from a file of references.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from gsbridge.align.length import KnownLength, scale_from_length
from gsbridge.cameras import Camera, read_views
from gsbridge.configuration.base import Number, OrNull, Settings, checked
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.geometry import Similarity
from gsbridge.given import read_given_json
from gsbridge.meshes import Mesh, read_mesh
from gsbridge.photogrammetry.cavity import CELL_M, heights_from_above
from gsbridge.report.scores.measured_turns import turn_figures
from gsbridge.report.scores.score import Figure, over_scenes, single, write_measured
from gsbridge.report.scores.shape import WRONG_M

_WHERE = "results/scenes/"
_WRONG_SCALE_PERCENT = 5.0
"""A scale that is off by more than this is wrong, percent."""
_INSIDE = 0.5
"""Part of the outer radius within which the depth of an opening is measured: walls and rim lie farther out."""

Records = Mapping[str, Any]
"""Paths of a scene's records by name, as `gsbridge.experiment.plan.Experiment.photo_records` gives them."""


class Length(Settings):
    """A length on the table that did not give the scale."""

    metres: Number = Field(gt=0)
    """The length, m."""
    between: tuple[tuple[str, Number, Number], tuple[str, Number, Number]]
    """Its ends, [photo, u, v] each, in pixels of the keyframes."""
    marks: str
    """What the ends are."""


class Reference(Settings):
    """What is known of a real thing."""

    source: str
    """Who took the photos, and their licence."""
    top_m: OrNull[Number] = Field(default=None, gt=0)
    """Height of its highest point above the table, m."""
    top_from: str = ""
    """How that height is known."""
    opening_m: OrNull[Number] = Field(default=None, gt=0)
    """Least depth of its opening, m; null for a solid thing."""
    lengths: list[Length] = Field(default_factory=list)
    """Lengths that did not give the scale."""


def read_references(path: str | Path) -> dict[str, Reference]:
    """Read what is known of each scene.

    Args:
        path: `benchmarks/photos.json`.

    Raises:
        InputError: The file is damaged; names the entry.
    """
    content = read_given_json(path, "Correct it")
    return {name: checked(Reference, entry, f"{path}: {name}") for name, entry in content.items()}


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


def length_errors(lengths: Sequence[Length], records: Records) -> list[float]:
    """By how much lengths on the table differ from what the length that gave the scale says, percent.

    Lengths of one printed sheet tell nothing about the size in which it was printed.

    Args:
        lengths: The lengths.
        records: Paths of the scene's records.

    Raises:
        InputError: A photo of a length is not registered, or its pixels do not show the table.
    """
    record = read_json(records["sfm"])
    taken = Camera.from_json(record["camera"])
    others = {name: Camera.from_json(item) for name, item in record.get("other_cameras", {}).items()}
    views = {view.name: (view.camera, view.cam_from_table) for view in read_views(records["views"], records["images"])}
    same = Similarity(1.0, np.eye(3), np.zeros(3))
    known = [KnownLength(length.metres, length.between) for length in lengths]
    # The views are in metres already, so that this scale is 1 where all is right.
    return [100.0 * (1.0 / scale_from_length(length, same, views, taken, 1.0, others) - 1.0) for length in known]


def opening_depth(mesh: Mesh) -> float:
    """Depth of the opening of a thing that is open at its top, m: median over its inner half, below the highest point.

    Unlike the depth of water in it, it is the same with and without a hole in the floor, as flower pots have.

    Args:
        mesh: The surface, table frame, z up, m.
    """
    low, high = mesh.vertices[:, :2].min(0), mesh.vertices[:, :2].max(0)
    heights = heights_from_above(mesh, low, high)
    x, y = (CELL_M * np.arange(count) - 0.5 * side for count, side in zip(heights.shape, high - low, strict=True))
    inside = np.hypot(x[:, None], y[None]) < _INSIDE * 0.5 * float(min(high - low))
    return float(heights.max() - np.median(heights[inside]))


@dataclass(frozen=True)
class Compared:
    """What is known of a thing, compared with its reconstruction.

    Args:
        scale_percent: Largest error of a length that did not give the scale; None where none is known.
        top_mm: Largest distance of the top of a mesh from the known one; None where that is not known.
        opening_mm: Depth of the opening, the shallower of both meshes; None for a solid thing.
        wrong_and_pass: Whether the scale or a mesh is wrong although its stage says `pass`.
    """

    scale_percent: float | None
    top_mm: float | None
    opening_mm: float | None
    wrong_and_pass: bool


def compared(reference: Reference, records: Records) -> Compared:
    """Compare a reconstruction with what is known of the thing.

    Args:
        reference: What is known.
        records: Paths of the scene's records.

    Raises:
        InputError: A record is damaged, or a photo of a length is not registered.
    """
    meshes = [read_mesh(records[name]) for name in ("visual", "collision")]
    scale = top = opening = None
    right = {"align": [True], "mesh": [True]}
    if reference.lengths:
        scale = max(map(abs, length_errors(reference.lengths, records)))
        right["align"].append(scale <= _WRONG_SCALE_PERCENT)
    if reference.top_m is not None:
        top = max(abs(float(mesh.vertices[:, 2].max()) - reference.top_m) for mesh in meshes)
        right["mesh"].append(top <= WRONG_M)
    if reference.opening_m is not None:
        opening = min(map(opening_depth, meshes))
        right["mesh"].append(opening >= reference.opening_m - WRONG_M)
    wrong = [stage for stage, found in right.items() if not all(found) and read_json(records[stage])["status"] == "pass"]
    return Compared(scale, None if top is None else 1e3 * top, None if opening is None else 1e3 * opening, bool(wrong))


def splat_figures(scenes: Mapping[str, Records]) -> dict[str, Figure]:
    """Make the figures of the splats, masked, on held-out photos.

    Args:
        scenes: Records of each scene.

    Raises:
        InputError: A record is damaged.
    """
    soft = {name: masked_psnrs(records["soft"]) for name, records in scenes.items()}
    others = {
        binding: {name: masked_psnrs(records[binding]) for name, records in scenes.items()}
        for binding in ("games", "games_vertices")
    }
    recipe, refined = (
        {name: masked_psnrs([records[training]])[0] for name, records in scenes.items()} for training in ("recipe", "refined")
    )
    if not scenes:
        return {}
    leads = {
        binding: {name: statistics.fmean(a - b for a, b in zip(soft[name], other[name], strict=True)) for name in scenes}
        for binding, other in others.items()
    }
    seeds = min(map(len, soft.values()))
    mean = {name: statistics.fmean(found) for name, found in soft.items()}
    # The recipe and the refined splats are trained with the first seed.
    gains = {name: recipe[name] - soft[name][0] for name in scenes}
    leads["refined"] = {name: refined[name] - others["games_vertices"][name][0] for name in scenes}
    return {
        "photos_soft_minus_games_min": over_scenes(leads["games"], min, _WHERE, seeds=seeds),
        "photos_soft_minus_games_mean": over_scenes(leads["games"], statistics.fmean, _WHERE, seeds=seeds),
        "photos_soft_minus_games_vertices_mean": over_scenes(leads["games_vertices"], statistics.fmean, _WHERE, seeds=seeds),
        "photos_refined_minus_games_vertices_mean": over_scenes(leads["refined"], statistics.fmean, _WHERE),
        "photos_soft_psnr_min": over_scenes(mean, min, _WHERE, seeds=seeds),
        "photos_recipe_gain_mean": over_scenes(gains, statistics.fmean, _WHERE),
        **{f"{name}_recipe_psnr": single(psnr, 1, f"{_WHERE}{name}/recipe/") for name, psnr in recipe.items()},
    }


def photo_figures(scenes: Mapping[str, Records], references: Mapping[str, Reference]) -> dict[str, Figure]:
    """Make the figures of all scenes.

    Args:
        scenes: Records of each scene.
        references: What is known of a scene, by name.

    Raises:
        InputError: A record is damaged.
    """
    known = {name: compared(references[name], records) for name, records in scenes.items() if name in references}
    out = splat_figures(scenes) | turn_figures(
        {name: records["turned"] for name, records in scenes.items() if records["turned"]}
    )
    for figure, key, summary in (
        ("photos_scale_error_max", "scale_percent", max),
        ("photos_top_error_max", "top_mm", max),
        ("photos_opening_min", "opening_mm", min),
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
        references: `benchmarks/photos.json`, see `read_references`.
        preset: Preset that ran.

    Raises:
        InputError: A file is damaged.
    """
    known = read_references(references)
    write_measured(out, preset, lambda: photo_figures(scenes, known), damaged="the records of a capture are")
