"""Non-rigid edits of one object: its mesh is deformed, its splats follow; the result is measured for each binding and drawn.

The paper shows an edited toy bear without numbers. Here every edit is also measured: see `gsbridge.scene.edit_quality` for what
the numbers mean and why none of them is an error against reality.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gsbridge.cameras import Camera, View, Views, read_views
from gsbridge.configuration.measuring import EditingSettings
from gsbridge.errors import InputError
from gsbridge.files import write_stage
from gsbridge.geometry import Array
from gsbridge.images import read_image
from gsbridge.mesh.fuse import vertex_colours
from gsbridge.meshes import Mesh
from gsbridge.report.figures.editing_drawing import Column, Picture, write_editing_figure
from gsbridge.scene.deform import Deformation, bend, bulge, deform, deformed_vertices, pull, sequence, shift_only, twist
from gsbridge.scene.edit_quality import Division, EditQuality, divide, framed, measure_edit, window_of
from gsbridge.scene.meshes import MeshComposition
from gsbridge.splats.binding import Binding, read_binding
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.evaluate import render_cloud

logger = logging.getLogger("gsbridge")

COMPARED = ("soft", "games", "refined")
CONTROL = "soft, centres only"
"""Control in which only the centres of soft splats follow the mesh; see `gsbridge.scene.deform.shift_only`."""

REST = "undeformed"
WHITE = 1.0
"""Grey level behind the object, 0..1: holes and spikes stand out against a dark bear, and print needs no ink."""

DIVISIONS = 2
"""Each division of the coloured mesh halves its edges; two make them smaller than a photo's pixels on the object."""

MOST_HOLES = 0.002
"""Share of the silhouette without cover above which the record is degraded: more is visible as a hole."""
MOST_SEEN_THROUGH = 0.01
"""Growth of the see-through share from rest to edit above which the record is degraded."""
MOST_SPILL = 0.002
"""Spilt share above which the record is degraded: more is visible as spikes."""


def edits(front: float) -> dict[str, Deformation]:
    """Make the edits, by title, the undeformed object first.

    Args:
        front: Direction from the object to the viewer, about z from +x, rad.
    """
    towards = np.array([np.cos(front), np.sin(front), 0.0])
    right, up = np.array([-towards[1], towards[0], 0.0]), np.array([0.0, 0.0, 1.0])
    turn_head = sequence(
        twist(np.radians(-40), low=0.5, high=0.64),
        bend(np.radians(22), front + 0.5 * np.pi, low=0.48, high=0.64),
    )
    return {
        REST: lambda vertices: vertices,
        "bent by 50°": bend(np.radians(50), front + 0.5 * np.pi),
        "twisted by 75°": twist(np.radians(75)),
        "widened by 40 %": bulge(0.4),
        "head turned and tilted": turn_head,
        "two ends pulled out": sequence(pull(up + 0.9 * right, 0.18, 0.45), pull(up - 0.9 * right, 0.18, 0.45)),
    }


def write_editing(scene: str | Path, figure: str | Path, record: str | Path, settings: EditingSettings) -> None:
    """Deform an object's mesh in several ways, measure how its splats follow, and draw them.

    The record holds for each binding and edit the figures of `EditQuality` over all held-out views; it is degraded where soft
    splats show holes, gaps or spikes that they do not show at rest.

    Args:
        scene: Folder of the scene, with `align/`, `sfm/images/` and `splats/{binding}/binding.npz`.
        figure: PNG, PDF or SVG.
        record: JSON.
        settings: What is shown.

    Raises:
        InputError: A file is missing or damaged, or a camera is inside the object.
    """
    folder = Path(scene)
    bindings = {name: read_binding(folder / "splats" / name / "binding.npz") for name in COMPARED}
    views = read_views(folder / "align" / "views.json", folder / "sfm" / "images")
    soft = bindings["soft"]
    middle = 0.5 * (soft.vertices.min(0) + soft.vertices.max(0))
    looked = list(views.of("held_out")) or list(views)
    near, side = _nearest(looked, middle, settings.azimuth_deg), _nearest(looked, middle, settings.azimuth_deg - 110)
    deformations = edits(_azimuth(near, middle))
    # All bindings of a scene share one surface, so the mesh of `soft` stands for all; the splats of each are deformed apart.
    division = divide(soft.faces, len(soft.vertices), DIVISIONS)
    colours = _photo_colours(soft, division, views)
    shapes = {name: deformed_vertices(soft, deformation) for name, deformation in deformations.items()}
    reach = np.concatenate(list(shapes.values()))
    try:
        windows = {view.name: framed(view.camera, view.cam_from_table, reach, settings.size) for view in looked}
    except ValueError as error:
        raise InputError(folder / "align" / "views.json", str(error), "Film the object from farther away") from error
    poses = [(windows[view.name][0], view.cam_from_table) for view in looked]
    figures: dict[str, dict[str, EditQuality]] = {name: {} for name in (*bindings, CONTROL)}
    columns = []
    for title, deformation in deformations.items():
        surface = Mesh(shapes[title], soft.faces)
        coloured = Mesh(division.weights @ surface.vertices, division.faces, colours)
        clouds = {name: deform(binding, deformation) for name, binding in bindings.items()}
        clouds[CONTROL] = shift_only(soft, deformation)
        for name, cloud in clouds.items():
            hung = bindings.get(name, soft).face_index
            figures[name][title] = measure_edit(cloud, hung, surface, coloured, poses)
            logger.info("%s, %s: %s", name, title, figures[name][title])
        pictures = {
            "mesh": _mesh_picture(coloured, windows[near.name][0], near.cam_from_table),
            **{name: _splat_picture(cloud, windows[near.name][0], near.cam_from_table) for name, cloud in clouds.items()},
            "soft from the side": _splat_picture(clouds["soft"], windows[side.name][0], side.cam_from_table),
        }
        columns.append(Column(title, pictures, {name: figures[name][title] for name in clouds}))
    photos = {
        "near": _photo(views, near, windows[near.name][1], settings.size),
        "side": _photo(views, side, windows[side.name][1], settings.size),
    }
    write_editing_figure(columns, photos, figure)
    write_stage(
        record,
        reasons=_reasons(figures["soft"]),
        packages=("numpy", "torch"),
        scene=folder.name,
        views=[view.name for view in looked],
        shown=[near.name, side.name],
        splats={name: len(binding) for name, binding in bindings.items()},
        edits={name: {title: dataclasses.asdict(value) for title, value in found.items()} for name, found in figures.items()},
    )


def _reasons(soft: Mapping[str, EditQuality]) -> list[str]:
    """List the edits that the splats of the soft binding do not follow, with what shows."""
    rest = soft[REST]
    reasons = []
    for title, found in soft.items():
        if found.holes > max(MOST_HOLES, rest.holes):
            reasons.append(f"{title}: {found.holes:.2%} of the silhouette is not covered")
        if found.see_through > rest.see_through + MOST_SEEN_THROUGH:
            seen, before = found.see_through, rest.see_through
            reasons.append(f"{title}: the inside shows on {seen:.2%} of the silhouette, at rest on {before:.2%}")
        if found.spill > max(MOST_SPILL, rest.spill):
            reasons.append(f"{title}: splats stand out over {found.spill:.2%} of the silhouette")
    return reasons


def _azimuth(view: View, middle: Array) -> float:
    """Direction from the object to a camera, about z from +x, rad."""
    towards = view.centre - middle
    return float(np.arctan2(towards[1], towards[0]))


def _nearest(views: Sequence[View], middle: Array, azimuth_deg: float) -> View:
    """Find the view whose direction from the object is nearest to an azimuth."""

    def away(view: View) -> float:
        return abs((_azimuth(view, middle) - np.radians(azimuth_deg) + np.pi) % (2 * np.pi) - np.pi)

    return min(views, key=away)


def _photo_colours(binding: Binding, division: Division, views: Views) -> Array:
    """Colours of the training photos on the finely divided rest mesh. [W, 3] float32."""
    seen = list(views.of("train")) or list(views)
    rest = Mesh(division.weights @ binding.vertices, division.faces)
    return vertex_colours(rest, seen, [read_image(views.path(view)) for view in seen])


def _splat_picture(cloud: Cloud, camera: Camera, pose: Array) -> Picture:
    colours, alphas = render_cloud(cloud, camera, pose)
    return np.clip(colours + WHITE * (1 - alphas[..., None]), 0, 1)


def _mesh_picture(mesh: Mesh, camera: Camera, pose: Array) -> Picture:
    image = MeshComposition({"mesh": mesh}).render(camera, pose, (WHITE,) * 3)
    return image.astype(np.float32) / 255


def _photo(views: Views, view: View, window: Array, size: int) -> Picture:
    return np.clip(window_of(read_image(views.path(view)), window, size), 0, 1)
