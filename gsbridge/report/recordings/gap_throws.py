"""Recording of a case of the gap about throws: measured, nominal and explained flights side by side, throw after throw."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import trimesh
from scipy.spatial.transform import Rotation

from gsbridge.files import read_json
from gsbridge.gap.contact.body import FreeBody, read_body
from gsbridge.geometry import Array
from gsbridge.report.gap.sections import JUDGED, read_series
from gsbridge.report.recordings.recording import recording

WAYS = {"measured": "Measured", "nominal": "Model as it was", "explained": "With the explanation"}
COLOURS = {"measured": [90, 100, 112], "nominal": [194, 102, 12], "explained": [31, 111, 139]}


def summary(found: Mapping[str, Any], note: str) -> str:
    """The finding as Markdown.

    Args:
        found: `findings.json`.
        note: What the viewer has to know about the pictures.
    """
    return f"**{str(found['verdict']).replace('_', ' ')}**\n\n{found['sentence']}\n\n{note}\n"


SHOWN = 12
"""Number of throws in a recording, spread evenly over all throws in the order of their mean distances before."""

PAUSE = 0.4
"""Pause between two throws, s."""

_GHOST = [200, 206, 213]
_PREFIX = {"measured": "", "nominal": "nominal_", "explained": "explained_"}


def record_throws(model: str | Path, findings: str | Path, series: str | Path, case: str, out: str | Path) -> None:
    """Record some throws of `verify`.

    Entities on the timeline `time` (s), on which throws follow one another: `{way}/body` for each way of
    `gsbridge.report.recordings.gap_throws.WAYS`, beside it, grey, `{way}/measured`; `{way}/path`, `{way}/surface`;
    `plots/distance/before` and `/after`, mm; `summary`.

    Args:
        model: Model file of the case.
        findings: `findings.json`.
        series: `replays.npz`.
        case: Name of the case.
        out: The `.rrd`.

    Raises:
        InputError: A file is missing or damaged.
    """
    found, motion, body = read_json(findings), read_series(series), read_body(model)
    ways = [way for way in WAYS if f"{JUDGED}/{_PREFIX[way]}position" in motion]
    number = motion[f"{JUDGED}/throw"].astype(int)
    sizes = np.bincount(number, weights=motion[f"{JUDGED}/before"]) / np.bincount(number)
    order = np.argsort(sizes)
    chosen = np.unique(np.linspace(0, len(order) - 1, min(SHOWN, len(order))).round().astype(int))
    rows = [np.flatnonzero(number == throw) for throw in order[chosen]]
    starts = np.cumsum([0.0, *(float(motion[f"{JUDGED}/time"][part[-1]]) + PAUSE for part in rows)])[:-1]
    clock = np.concatenate([motion[f"{JUDGED}/time"][part] + start for part, start in zip(rows, starts, strict=True)])
    with recording(out, "gap", case, _layout(ways)) as stream:
        note = f"{len(rows)} of {len(sizes)} throws, from small to large distance before. Grey: as measured."
        stream.log("summary", rr.TextDocument(summary(found, note), media_type="text/markdown"), static=True)
        for way in ways:
            _log_body(stream, f"{way}/body", body, COLOURS[way], motion, _PREFIX[way], rows, clock)
            if way != "measured":
                _log_body(stream, f"{way}/measured", body, _GHOST, motion, "", rows, clock)
            for part, start in zip(rows, starts, strict=True):
                stream.set_time("time", duration=float(start))
                path = motion[f"{JUDGED}/{_PREFIX[way]}position"][part]
                stream.log(f"{way}/path", rr.LineStrips3D([path], colors=COLOURS[way]))
            _log_surface(stream, f"{way}/surface", body, motion[f"{JUDGED}/position"])
        _log_distances(stream, motion, np.concatenate(rows), clock)


def solid(body: FreeBody) -> tuple[Array, Array]:
    """Surface of a body in its own frame, from the shapes of its URDF. Vertices [V, 3], m; triangles [F, 3]."""
    parts = []
    for text in body.shapes:
        element = ElementTree.fromstring(text)
        shape = element.find("geometry/*")
        assert shape is not None
        figures = {key: np.array(value.split(), dtype=float) for key, value in shape.attrib.items() if key != "filename"}
        if shape.tag == "box":
            part = trimesh.creation.box(figures["size"])
        elif shape.tag == "sphere":
            part = trimesh.creation.icosphere(subdivisions=3, radius=float(figures["radius"][0]))
        elif shape.tag == "cylinder":
            part = trimesh.creation.cylinder(float(figures["radius"][0]), float(figures["length"][0]))
        elif shape.tag == "capsule":
            part = trimesh.creation.capsule(float(figures["length"][0]), float(figures["radius"][0]))
            part.apply_translation(-part.bounds.mean(axis=0))
        else:
            part = trimesh.load_mesh(shape.attrib["filename"])
            part.apply_scale(figures["scale"])
        origin = element.find("origin")
        place = {} if origin is None else origin.attrib
        pose = np.eye(4)
        pose[:3, 3] = [float(value) for value in place.get("xyz", "0 0 0").split()]
        pose[:3, :3] = Rotation.from_euler("xyz", [float(value) for value in place.get("rpy", "0 0 0").split()]).as_matrix()
        part.apply_transform(pose)
        parts.append(part)
    whole: Any = trimesh.util.concatenate(parts)
    return np.asarray(whole.vertices, dtype=np.float64), np.asarray(whole.faces)


def _log_body(
    stream: rr.RecordingStream,
    entity: str,
    body: FreeBody,
    colour: list[int],
    motion: Mapping[str, Array],
    prefix: str,
    rows: list[Array],
    clock: Array,
) -> None:
    """Log a body and its poses over time."""
    vertices, triangles = solid(body)
    # Every triangle has corners of its own, so that edges stay sharp.
    corners = vertices[triangles].reshape(-1, 3)
    normals = np.repeat(np.cross(corners[1::3] - corners[::3], corners[2::3] - corners[::3]), 3, axis=0)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    indices = np.arange(len(corners)).reshape(-1, 3)
    mesh = rr.Mesh3D(vertex_positions=corners, triangle_indices=indices, vertex_normals=normals, albedo_factor=colour)
    stream.log(entity, mesh, static=True)
    chosen = np.concatenate(rows)
    stream.send_columns(
        entity,
        [rr.TimeColumn("time", duration=clock.astype(np.float64))],
        rr.Transform3D.columns(
            translation=motion[f"{JUDGED}/{prefix}position"][chosen],
            quaternion=np.roll(motion[f"{JUDGED}/{prefix}quat"][chosen], -1, axis=1),
        ),
    )


def _log_surface(stream: rr.RecordingStream, entity: str, body: FreeBody, position: Array) -> None:
    """Log a square of the surface that the throws hit, as wide as the throws spread."""
    middle = 0.5 * (position.min(axis=0) + position.max(axis=0))
    half = 0.5 * (position.max(axis=0) - position.min(axis=0)).max()
    turn = Rotation.from_euler("xyz", [body.figures["tilt_x"], body.figures["tilt_y"], 0.0])
    base = np.array([0.0, 0.0, body.figures["height"]])
    flat = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half + [middle[0], middle[1], 0.0]
    corners = turn.apply(flat) + base
    stream.log(
        entity,
        rr.Mesh3D(vertex_positions=corners, triangle_indices=[[0, 1, 2], [0, 2, 3]], albedo_factor=[235, 238, 241]),
        static=True,
    )


def _log_distances(stream: rr.RecordingStream, motion: Mapping[str, Array], rows: Array, clock: Array) -> None:
    """Log the distances to the measured position, mm, every sample."""
    times = [rr.TimeColumn("time", duration=clock.astype(np.float64))]
    for when, way in (("before", "nominal"), ("after", "explained")):
        if f"{JUDGED}/{when}" in motion:
            entity = f"plots/distance/{when}"
            stream.log(entity, rr.SeriesLines(names=WAYS[way], colors=COLOURS[way]), static=True)
            stream.send_columns(entity, times, rr.Scalars.columns(scalars=1e3 * motion[f"{JUDGED}/{when}"][rows]))


def _layout(ways: list[str]) -> rrb.Container:
    """Bodies side by side above, distances below."""
    spaces = [rrb.Spatial3DView(origin=way, name=WAYS[way], contents="$origin/**") for way in ways]
    plot = rrb.TimeSeriesView(origin="plots/distance", name="Distance to what was measured, mm")
    return rrb.Vertical(
        rrb.Horizontal(*spaces, rrb.TextDocumentView(origin="summary", name="Finding")), plot, row_shares=[3, 2]
    )
