"""Reading an asset: the record and the files beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.asset.body import MassProperties
from gsbridge.asset.relief import Relief
from gsbridge.asset.rim import Rim
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh, read_mesh
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.ply import read_ply


@dataclass(frozen=True)
class Asset:
    """A bundle that a simulator can load.

    Args:
        kind: `object` (rigid body in its body frame) or `background` (static, table frame).
        urdf: URDF of one link, `body`; its collision meshes leave room for Bullet's margin.
        hulls: Convex meshes of the true size, body frame, for engines without a margin (objects only).
        visual: Mesh with vertex colours.
        splats: Splats in the body frame.
        body_from_table: Transform from the table frame of the capture to the body frame. [4, 4].
        properties: Mass, centre of mass, inertia; None for a background.
        height: Highest point above the table, m.
        width: Narrowest horizontal width, m.
        rim: Where the wall of a vessel can be grasped; None if there is no such place, or the object is no vessel.
        relief: The raised part of a background's table; None for a flat background and for objects.
        relief_urdf: URDF of the raised part alone, static and concave, table frame.
    """

    kind: str
    urdf: Path
    hulls: tuple[Path, ...]
    visual: Path
    splats: Path
    body_from_table: Array
    properties: MassProperties | None
    height: float
    width: float
    rim: Rim | None = None
    relief: Relief | None = None
    relief_urdf: Path | None = None

    def cloud(self) -> Cloud:
        """The splats, body frame."""
        return read_ply(self.splats)

    def mesh(self) -> Mesh:
        """The visual mesh, body frame."""
        return read_mesh(self.visual)


def read_asset(path: str | Path) -> Asset:
    """Read `asset.json`.

    Raises:
        InputError: The record is damaged, or a file of the bundle is missing.
    """
    content = read_json(path)
    folder = Path(path).parent
    try:
        files = content["files"]
        body = content["body"]
        relief = Relief.from_json(content.get("relief"))
        asset = Asset(
            kind=content["kind"],
            urdf=folder / files["urdf"],
            hulls=tuple(folder / name for name in files["hulls"]),
            visual=folder / files["visual"],
            splats=folder / files["splats"],
            body_from_table=np.array(content["body_from_table"], dtype=np.float64).reshape(4, 4),
            properties=None
            if body is None
            else MassProperties(body["volume"], body["mass"], np.array(body["centre"]), np.array(body["inertia"])),
            height=float(content["height"]),
            width=float(content["width"]),
            rim=Rim.from_json(content.get("rim")),
            relief=relief,
            relief_urdf=None if relief is None else folder / files["relief"],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(path, f"the record is damaged ({error})", "Delete it and run the asset stage again") from error
    more = () if asset.relief_urdf is None else (asset.relief_urdf,)
    for file in (asset.urdf, asset.visual, asset.splats, *asset.hulls, *more):
        if not file.is_file():
            raise InputError(file, "a file of the asset is missing", "Run the asset stage again")
    return asset
