"""The asset stage: meshes, splats and alignment in, a bundle for simulators out."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.asset.body import body_from_table, mass_properties, narrowest_width
from gsbridge.asset.bullet import rest_check
from gsbridge.asset.density import DENSITIES
from gsbridge.asset.hulls import decompose, filled_depth, hull_mesh, inset, seat, simplify
from gsbridge.asset.photos import AssetPhotos, compare_with_photos
from gsbridge.asset.relief import RELIEF_URDF, find_relief, simplified
from gsbridge.asset.rim import find_rim
from gsbridge.asset.solid import choose_solid
from gsbridge.asset.urdf import write_body_urdf, write_obj
from gsbridge.configuration.asset import AssetSettings
from gsbridge.errors import InputError
from gsbridge.files import atomic_directory, read_json, write_stage
from gsbridge.geometry import Array, Similarity
from gsbridge.meshes import Mesh, read_mesh, write_mesh
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.ply import read_ply, write_ply

logger = logging.getLogger("gsbridge")

KINDS = ("object", "background")

MAX_PENETRATION_MM = 0.5
MAX_DRIFT_MM = 1.0
MAX_DRIFT_DEG = 1.0
SEATED = 1e-4
"""Hulls stand on z = 0 within this, m."""

_ON_TABLE = 1e-3
"""A surface that ends this close to the table stands on it, m; this is the tolerance of the foot."""
_LARGEST_BACKGROUND = 5.0
_FILLED = 1.5
"""Hulls may fill dents up to the concavity in the settings; a depth of more than this many times the concavity means that there
were too few hulls."""


@dataclass(frozen=True)
class AssetInputs:
    """Files of one scene that an asset is made of, all in the table frame.

    Args:
        visual: Mesh with colours.
        collision: Watertight hull.
        splats: Splats of the chosen binding.
        align: Record of the align stage.
    """

    visual: str | Path
    collision: str | Path
    splats: str | Path
    align: str | Path


@dataclass(frozen=True)
class AssetOutputs:
    """Files of an asset. All lie in one folder, as `asset.json` and the URDF refer to the others by relative paths.

    Args:
        urdf: `body.urdf`.
        hulls: Folder `hulls/` of all OBJ meshes.
        visual: `visual.ply`, with colours.
        splats: `splats.ply`.
        record: `asset.json`.
    """

    urdf: str | Path
    hulls: str | Path
    visual: str | Path
    splats: str | Path
    record: str | Path


def build_asset(
    inputs: AssetInputs,
    outputs: AssetOutputs,
    settings: AssetSettings | None = None,
    *,
    name: str,
    kind: str = "object",
    seed: int = 0,
    photos: AssetPhotos | None = None,
) -> None:
    """Bundle a scene for simulators.

    Args:
        inputs, outputs: Files.
        settings: See `AssetSettings`.
        name: Name of the scene, for the URDF.
        kind: `object` or `background`.
        seed: Seed of the convex decomposition.
        photos: Photos to compare the bundle with; None for no comparison.

    Raises:
        InputError: A file or setting cannot be used: mesh missing, not watertight, of the wrong scale, off the table; scale
            unknown; splats away from the mesh; density unknown.
    """
    settings = settings or AssetSettings()
    if kind not in KINDS:
        raise InputError("asset: kind", f"{kind!r} is unknown", f"Use one of {', '.join(KINDS)}")
    density = DENSITIES[settings.density] if isinstance(settings.density, str) else settings.density
    _check_scale_known(inputs.align)
    visual, collision, cloud = read_mesh(inputs.visual), read_mesh(inputs.collision), read_ply(inputs.splats)
    _check_size(visual, inputs.visual, settings, kind)
    _check_size(collision, inputs.collision, settings, kind)
    _check_place(cloud, visual, inputs)
    if kind == "object":
        pose, reasons, figures = _build_object(visual, collision, inputs, outputs, settings, name, density, seed)
    else:
        pose, reasons, figures = _build_background(visual, collision, inputs, outputs, name)
    moved = Similarity.from_matrix(pose)
    visual = Mesh(moved.apply(visual.vertices), visual.faces, visual.colours)
    write_mesh(outputs.visual, visual)
    write_ply(outputs.splats, cloud.transformed(moved))
    looks = None
    if photos is not None:
        # The written file is checked instead of the splats in memory.
        looks = compare_with_photos(read_ply(outputs.splats), pose, photos, kind=kind, visual=inputs.visual)
        if not looks["kept"]:
            reasons.append(f"the bundle's PSNR is {looks['psnr']} dB, that of the splats stage {looks['stage_psnr']} dB")
    record = Path(outputs.record)
    files = {"urdf": outputs.urdf, "visual": outputs.visual, "splats": outputs.splats}
    if figures.get("relief"):
        files["relief"] = Path(outputs.hulls) / RELIEF_URDF
    write_stage(
        record,
        reasons=reasons,
        seed=seed,
        packages=("coacd", "pybullet", "scipy"),
        kind=kind,
        files={
            **{key: os.path.relpath(path, record.parent) for key, path in files.items()},
            "hulls": [os.path.relpath(path, record.parent) for path in sorted(Path(outputs.hulls).glob("hull_*.obj"))],
        },
        body_from_table=pose,
        height=float(visual.vertices[:, 2].max()),
        width=narrowest_width(visual.vertices),
        splats=len(cloud),
        settings=settings.model_dump(),
        photos=looks,
        **figures,
    )
    logger.info("%s: asset of %d splats%s", name, len(cloud), f", degraded: {'; '.join(reasons)}" if reasons else "")


def _check_scale_known(align: str | Path) -> None:
    """Refuse a capture whose unit is not known."""
    if read_json(align).get("scale_source", "unknown") == "unknown":
        raise InputError(
            align,
            "the scale of the capture is unknown, so the body has no size or mass",
            "Film it with the board, or give a length",
        )


def _check_size(mesh: Mesh, path: str | Path, settings: AssetSettings, kind: str) -> None:
    """Refuse bodies of implausible size."""
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    largest = settings.largest if kind == "object" else _LARGEST_BACKGROUND
    if not settings.smallest <= longest <= largest:
        raise InputError(
            path,
            f"the {kind} measures {longest:.4g} m; {settings.smallest:g} to {largest:g} m are plausible",
            "Check the scale of the align stage (size of the board's tags, known length)",
        )


def _check_place(cloud: Cloud, visual: Mesh, inputs: AssetInputs) -> None:
    """Refuse splats of another scene or frame."""
    low, high = visual.vertices.min(0), visual.vertices.max(0)
    slack = 0.25 * float((high - low).max())
    inside = ((cloud.means > low - slack) & (cloud.means < high + slack)).all(1)
    if inside.mean() < 0.9:
        raise InputError(
            inputs.splats,
            f"{100 * (1 - inside.mean()):.0f} % of the splats lie away from the mesh {inputs.visual}",
            "Take mesh and splats of the same scene, and run the splats stage again",
        )


def _standing(solid: Mesh, path: str | Path, floating: float) -> tuple[Array, list[str]]:
    """`body_from_table`, with a small gap to the table closed and noted."""
    pose = body_from_table(solid)
    lowest = float(solid.vertices[:, 2].min())
    if abs(lowest) > floating:
        raise InputError(
            path, f"the object's lowest point is {1e3 * lowest:.1f} mm above the table", "Check the align and mesh stages"
        )
    if abs(lowest) <= _ON_TABLE:
        return pose, []
    pose[2, 3] = -lowest
    return pose, [f"the object's lowest point was {1e3 * lowest:.1f} mm above the table; the body was moved there"]


def _build_object(
    visual: Mesh,
    collision: Mesh,
    inputs: AssetInputs,
    outputs: AssetOutputs,
    settings: AssetSettings,
    name: str,
    density: float,
    seed: int,
) -> tuple[Array, list[str], dict[str, Any]]:
    """Hulls, URDF and figures of a rigid body; returns `body_from_table`, reasons and figures."""
    chosen = choose_solid(visual, collision, inputs.visual, inputs.collision)
    pose, more = _standing(chosen.mesh, inputs.visual if chosen.which == "visual" else inputs.collision, settings.floating)
    reasons = [*chosen.reasons, *more]
    solid = Mesh(chosen.mesh.vertices + pose[:3, 3], chosen.mesh.faces)
    properties = mass_properties(solid, density)
    parts = decompose(solid, concavity=settings.concavity, most=settings.most_hulls, seed=seed)
    hulls = [simplify(part, settings.hull_tolerance, settings.hull_vertices) for part in seat(parts, settings.foot)]
    shrunk, moves = _for_bullet(hulls, settings)
    if min(moves) < 0.99 * settings.margin:
        count = sum(move < 0.99 * settings.margin for move in moves)
        reasons.append(f"{count} of {len(hulls)} hulls are too thin for the whole collision margin and stand out a little")
    filled = filled_depth(hulls, solid)
    if filled > _FILLED * settings.concavity:
        few = (
            f", and `asset.most_hulls` ({settings.most_hulls}) allows no more hulls"
            if len(hulls) >= settings.most_hulls
            else ""
        )
        reasons.append(
            f"the collision hulls fill {1e3 * filled:.0f} mm of what the surface leaves free; "
            f"{1e3 * settings.concavity:g} mm are meant{few}"
        )
    rim = find_rim(solid)
    collisions = _write_meshes(outputs, {"hull": hulls, "bullet": shrunk}, _shifted(visual, pose))
    write_body_urdf(outputs.urdf, name, properties, visual=collisions["visual"][0], collisions=collisions["bullet"])
    lowest = min(float(hull[:, 2].min()) for hull in hulls)
    if abs(lowest) > SEATED:
        reasons.append(f"the hulls stand {1e3 * lowest:.2f} mm above the table")
    rest = rest_check(outputs.urdf)
    for value, limit, text in (
        (rest.penetration_mm, MAX_PENETRATION_MM, "mm deep in the table at rest"),
        (rest.drift_mm, MAX_DRIFT_MM, "mm moved while settling"),
        (rest.drift_deg, MAX_DRIFT_DEG, "degrees turned while settling"),
    ):
        if value > limit:
            reasons.append(f"{value:.2f} {text}; {limit:g} are allowed")
    return (
        pose,
        reasons,
        {
            "solid": chosen.which,
            "rim": None if rim is None else asdict(rim),
            "body": {**asdict(properties), "density": density},
            "hulls": {
                "count": len(hulls),
                "vertices": sum(len(hull) for hull in hulls),
                "volume": sum(hull_mesh(hull).volume() for hull in hulls),
                "lowest_mm": 1e3 * lowest,
                "filled_mm": 1e3 * filled,
            },
            "outline_hull_volume": collision.volume(),
            "rest": rest.to_json(),
        },
    )


def _for_bullet(hulls: Sequence[Array], settings: AssetSettings) -> tuple[list[Array], list[float]]:
    """Shrink hulls to leave room for Bullet's margin; also return by how much each was shrunk, m."""
    out, moves = [], []
    for hull in hulls:
        smaller, moved = inset(hull, settings.margin) if settings.margin > 0 else (hull, 0.0)
        foot = float(smaller[:, 2].min())
        # Reduce the vertices again without losing the foot: it is shifted to z = 0, where `simplify` keeps points most closely.
        down = np.array([0.0, 0.0, foot])
        out.append(
            simplify(
                np.where(np.abs(smaller - down) < 1e-9, 0.0, smaller - down), settings.hull_tolerance, settings.hull_vertices
            )
            + down
        )
        moves.append(moved)
    return out, moves


def _shifted(mesh: Mesh, pose: Array) -> Mesh:
    return Mesh(mesh.vertices + pose[:3, 3], mesh.faces)


def _write_meshes(outputs: AssetOutputs, hulls: dict[str, list[Array]], visual: Mesh) -> dict[str, list[str]]:
    """Write the folder of OBJ meshes; returns their paths from the URDF, by kind."""
    folder = os.path.relpath(outputs.hulls, Path(outputs.urdf).parent)
    names: dict[str, list[str]] = {"visual": [f"{folder}/visual.obj"]}
    with atomic_directory(outputs.hulls) as temporary:
        write_obj(temporary / "visual.obj", visual)
        for kind, parts in hulls.items():
            names[kind] = [f"{folder}/{kind}_{index:02d}.obj" for index in range(len(parts))]
            for path, part in zip(names[kind], parts, strict=True):
                write_obj(temporary / Path(path).name, hull_mesh(part))
    return names


def _write_relief(folder: Path, visual: Mesh, name: str) -> dict[str, float] | None:
    """Write a body of the table's raised part, from the visual mesh, as the whole table's collision mesh is too coarse."""
    found = find_relief(visual)
    if found is None:
        return None
    relief, surface = found
    # No room is left for a margin here: Bullet gives a concave mesh none against hulls, and the hulls were shrunk by their own.
    write_obj(folder / "relief.obj", simplified(surface))
    write_body_urdf(folder / RELIEF_URDF, f"{name}_relief", None, visual="relief.obj", collisions=["relief.obj"])
    return asdict(relief)


def _build_background(
    visual: Mesh, collision: Mesh, inputs: AssetInputs, outputs: AssetOutputs, name: str
) -> tuple[Array, list[str], dict[str, Any]]:
    """Static concave body in the table frame."""
    if not collision.is_watertight():
        raise InputError(
            inputs.collision, "the mesh is not watertight, so bodies could fall into it", "Run the mesh stage again"
        )
    folder = os.path.relpath(outputs.hulls, Path(outputs.urdf).parent)
    with atomic_directory(outputs.hulls) as temporary:
        write_obj(temporary / "visual.obj", visual)
        write_obj(temporary / "concave.obj", collision)
        standing = _write_relief(temporary, visual, name)
    write_body_urdf(outputs.urdf, name, None, visual=f"{folder}/visual.obj", collisions=[f"{folder}/concave.obj"])
    return np.eye(4), [], {"solid": "collision", "body": None, "faces": len(collision.faces), "relief": standing}
