"""Splats of the robot's links: made once from the robot's meshes, kept in a folder, drawn with everything else.

Colours are those of the robot's description, or given; they never come from the mirror.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import atomic_directory, read_json, write_json
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.robot.assembly import RobotFiles
from gsbridge.robot.links import Colour
from gsbridge.scene.link_fit import STEPS, fit_to_mesh
from gsbridge.scene.link_splats import splats_on_mesh
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.ply import read_ply, write_ply

TOTAL = 8000
"""Splats of the whole robot: the desktop budget."""

HAND_SHARE = 0.85
"""Share of the splats on links beyond the flange: the wrist camera sees these links close by, and the arm hardly ever."""

FEWEST = 24
RECORD = "robot_splats.json"


def link_meshes(robot: RobotFiles, colours: Mapping[str, Colour] | None = None) -> dict[str, Mesh]:
    """One mesh per drawn link, link frame, with vertex colours.

    Args:
        robot: The robot's files.
        colours: sRGB by link, which replaces the description's.

    Raises:
        InputError: A colour is given for a link that is not drawn.
    """
    given = dict(colours or {})
    visuals = robot.visuals()
    unknown = set(given) - set(visuals)
    if unknown:
        raise InputError(
            "robot colours", f"{', '.join(sorted(unknown))} is no drawn link", f"Use some of {', '.join(sorted(visuals))}"
        )
    return {link: _joined([(mesh, given.get(link, colour)) for mesh, colour in parts]) for link, parts in visuals.items()}


def _joined(parts: Sequence[tuple[Mesh, Colour]]) -> Mesh:
    """Several meshes in one colour each as one mesh."""
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh, _ in parts)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh, _ in parts]),
        np.concatenate([mesh.faces + offset for (mesh, _), offset in zip(parts, offsets[:-1], strict=True)]),
        np.concatenate([np.tile(np.asarray(colour, np.float32), (len(mesh.vertices), 1)) for mesh, colour in parts]),
    )


def robot_splats(
    robot: RobotFiles,
    total: int = TOTAL,
    *,
    colours: Mapping[str, Colour] | None = None,
    fit_steps: int = STEPS,
    seed: int = 0,
) -> dict[str, Cloud]:
    """Splats of every drawn link, link frames, fitted to the links' silhouettes (some seconds per link of the hand).

    Args:
        robot: The robot's files.
        total: Splats of all links together; shared by area, most of them on the hand.
        colours: See `link_meshes`.
        fit_steps: Steps of `fit_to_mesh` for the hand's links; 0 leaves the splats as they are spread.
        seed: Seed of places and of the fit.

    Raises:
        InputError: Fewer splats than the links need, or an unknown link.
    """
    meshes = link_meshes(robot, colours)
    if total < 2 * FEWEST * len(meshes):
        raise InputError("robot splats", f"{total} are too few for {len(meshes)} links", f"Give {2 * FEWEST * len(meshes)}")
    arm = set(robot.record["arm_links"])
    areas = {name: float(mesh.areas().sum()) for name, mesh in meshes.items()}
    out = {}
    for number, (name, mesh) in enumerate(meshes.items()):
        group = [other for other in meshes if (other in arm) == (name in arm)]
        share = (1.0 - HAND_SHARE if name in arm else HAND_SHARE) * total - FEWEST * len(group)
        count = FEWEST + int(share * areas[name] / sum(areas[other] for other in group))
        cloud = splats_on_mesh(mesh, count, seed=seed + number)
        if fit_steps > 0 and name not in arm:
            cloud = fit_to_mesh(cloud, mesh, steps=fit_steps, seed=seed + number)
        out[name] = cloud
    return out


def write_robot_splats(folder: str | Path, splats: Mapping[str, Cloud]) -> None:
    """Keep the links' splats: one 3DGS PLY per link, which viewers open, and a record; the folder appears whole."""
    with atomic_directory(folder) as temporary:
        for name, cloud in splats.items():
            write_ply(temporary / f"{name}.ply", cloud)
        write_json(temporary / RECORD, {"links": {name: len(cloud) for name, cloud in splats.items()}})


def read_robot_splats(folder: str | Path) -> dict[str, Cloud]:
    """Splats that `write_robot_splats` kept.

    Raises:
        InputError: The folder is incomplete or damaged.
    """
    record = Path(folder) / RECORD
    links = read_json(record).get("links")
    if not isinstance(links, dict) or not links:
        raise InputError(record, "the record names no links", "Build the robot's splats again")
    out = {name: read_ply(Path(folder) / f"{name}.ply") for name in links}
    for name, cloud in out.items():
        if len(cloud) != links[name]:
            raise InputError(
                Path(folder) / f"{name}.ply",
                f"it holds {len(cloud)} splats, not {links[name]}",
                "Build the robot's splats again",
            )
    return out


def mean_cloud_colour(cloud: Cloud) -> Array:
    """Mean sRGB colour of splats, by the light each sends (opacity times area). [3]."""
    weight = np.sort(cloud.scales.astype(np.float64), axis=1)[:, 1:].prod(1) * cloud.opacities
    return np.asarray((weight @ cloud.colours) / max(float(weight.sum()), 1e-30))
