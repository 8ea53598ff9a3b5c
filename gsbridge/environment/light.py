"""Calibration of the light over the work table: the table round a filmed object is compared with the table without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gsbridge.asset.bundle import Asset, read_asset
from gsbridge.cameras import View, Views, read_views
from gsbridge.environment.photometry import OPAQUE, fit_response
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_stage
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, read_image, read_mask, srgb_from_linear
from gsbridge.logs import ProgressLog
from gsbridge.robot.assembly import RobotFiles
from gsbridge.scene.editing import Composition
from gsbridge.scene.light import WIDTH, SkyLight, directions, fit_light
from gsbridge.scene.occlusion import moved, spheres_in, transmittances
from gsbridge.scene.shadows import Shadows
from gsbridge.scene.underlay import with_underlay
from gsbridge.scene.view import shoot

PICTURE_WIDTH = 320
"""Photos are shrunk to this many pixels: finer detail than the splats hold would only add scatter."""

REACH = 0.25
"""Distance from the object, m, up to which its shadow is looked for."""

OBJECT_SPHERES, PART_SPHERES = 40, 8
"""Spheres that stand for the object, and for each part of a link."""

_EVERY_VIEW, _EVERY_PIXEL = 2, 7
_MASK_BORDER = 5
_LIT = 0.3
"""Share of the places, the least shaded ones, from which the difference in colour between the two films is fitted."""

_SHADED = 0.9
_EXPLAINED = 0.9
_SCATTER = 0.15
"""Limits of a good fit. Over the places that see less of the sky than `_SHADED`, the fitted light must leave less than
`_EXPLAINED` of the median error. Over all places, the ratios may scatter by `_SCATTER`: the mirror's films scatter by 0.05,
and by 0.26 if the splats are those of another table."""

_DARK = 0.03
"""Linear value below which a ratio would be noise."""


@dataclass(frozen=True)
class FilmedShadow:
    """An object's film, and the table without it.

    Args:
        item: `asset.json` of the object.
        views: Registered photos of the film.
        masks: Folder of their masks.
        background: `asset.json` of the table that it stood on.
    """

    item: str | Path
    views: Views
    masks: str | Path
    background: str | Path

    @classmethod
    def of(cls, inputs: Mapping[str, str]) -> FilmedShadow | None:
        """Take the files from a rule's inputs; None where no object was filmed on the table.

        Raises:
            InputError: The views cannot be read.
        """
        if "item" not in inputs:
            return None
        return cls(inputs["item"], read_views(inputs["views"], inputs["images"]), inputs["masks"], inputs["background"])


def calibrate_light(record: str | Path, *, robot: str | Path, shown: FilmedShadow | None) -> None:
    """Calibrate the light over the table, and approximate the robot by spheres that shade it.

    Args:
        record: Record of the stage; `LightFile` reads it.
        robot: Folder of the robot's description.
        shown: Film of an object's shadow; None for no light and a degraded result.

    Raises:
        InputError: A file is missing or damaged, or the photos show too little of the table.
    """
    parts = RobotFiles.read(robot).visuals()
    spheres = {
        name: np.concatenate([spheres_in(mesh, PART_SPHERES) for mesh, _ in meshes]).tolist() for name, meshes in parts.items()
    }
    if shown is None:
        reason = "no object was filmed on the table of the work place: pictures have no shadows"
        write_stage(record, reasons=[reason], light=None, robot=spheres)
        return
    transmitted, ratios = _places(read_asset(shown.item), shown.views, Path(shown.masks), read_asset(shown.background))
    light, scatter = fit_light(transmitted, ratios)
    shaded = transmitted.mean(1) < _SHADED
    before = float(np.median(np.abs(ratios[shaded] - 1.0))) if shaded.any() else 0.0
    after = float(np.median(np.abs((ratios - light.floor - transmitted @ light.shares)[shaded]))) if shaded.any() else 0.0
    reasons = []
    if after >= _EXPLAINED * before:
        reasons.append("the light explains little of the object's shadow: was it filmed in one light?")
    if scatter > _SCATTER:
        reasons.append(f"the table round the object scatters by {100 * scatter:.0f} % round its splats: was it this table?")
    write_stage(
        record,
        reasons=reasons,
        packages=("scipy", "open3d"),
        light=light.record(),
        robot=spheres,
        places=len(ratios),
        shaded=int(shaded.sum()),
        scatter=scatter,
        median_error_before=before,
        median_error_after=after,
    )


def _places(item: Asset, views: Views, masks: Path, background: Asset) -> tuple[Array, Array]:
    """Transmittances [N, M] and brightness ratios [N] of places on the table round the object."""
    table_from_body = np.linalg.inv(item.body_from_table)
    spheres = moved(spheres_in(item.mesh(), OBJECT_SPHERES), table_from_body)
    floor = Composition({}, with_underlay(background.cloud(), background.mesh()))
    drawn: list[Array] = []
    seen: list[Array] = []
    points: list[Array] = []
    chosen = list(views)[::_EVERY_VIEW]
    progress = ProgressLog(len(chosen), "photos")
    for view in chosen:
        before, after, where = _compared(view, views.path(view), masks, floor, table_from_body[:2, 3])
        drawn.append(before)
        seen.append(after)
        points.append(where)
        progress.update()
    before, after = np.concatenate(drawn), np.concatenate(seen)
    transmitted = transmittances(np.concatenate(points), spheres, directions(), WIDTH)
    # The two films differ in exposure and white balance; this difference is fitted where there is no shadow.
    open_sky = transmitted.mean(1)
    response = fit_response(*(values[open_sky >= np.quantile(open_sky, 1.0 - _LIT)] for values in (before, after)))
    light = linear_from_srgb(before).mean(1)
    usable = light > _DARK
    ratios = linear_from_srgb(response.undo(after)).mean(1)[usable] / light[usable]
    return transmitted[usable], np.clip(ratios, 0.0, 2.0)


def _compared(view: View, path: Path, masks: Path, floor: Composition, middle: Array) -> tuple[Array, Array, Array]:
    """Return the table's colours round the object in splats and photo, [N, 3] each, and the places, table frame, m. [N, 3]."""
    small = view.camera.scaled(PICTURE_WIDTH / view.camera.width)
    size = (small.width, small.height)
    light = linear_from_srgb(read_image(path).astype(np.float64)).astype(np.float32)
    photo = srgb_from_linear(cv2.resize(light, size, interpolation=cv2.INTER_AREA).astype(np.float64))
    mask = cv2.resize(read_mask(masks / f"{Path(view.name).stem}.png").astype(np.float32), size, interpolation=cv2.INTER_AREA)
    hidden = cv2.dilate((mask > 0.05).astype(np.uint8), np.ones((_MASK_BORDER, _MASK_BORDER))) > 0
    shot = shoot(floor, small, view.cam_from_table)
    table_from_cam = np.linalg.inv(view.cam_from_table)
    rays = small.pixel_rays() @ table_from_cam[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        points = table_from_cam[:3, 3] - (table_from_cam[2, 3] / rays[..., 2])[..., None] * rays
    near = np.linalg.norm(points[..., :2] - middle, axis=-1) < REACH
    inside = np.flatnonzero((shot.alphas > OPAQUE) & ~hidden & near & (rays[..., 2] < 0))[::_EVERY_PIXEL]
    pixels = shot.pixels.reshape(-1, 3)[inside] / 255.0
    return pixels, photo.reshape(-1, 3)[inside], points.reshape(-1, 3)[inside]


@dataclass(frozen=True)
class LightFile:
    """Result of `calibrate_light`.

    Args:
        light: The calibrated light; None where no film shows it.
        robot: Spheres of the links, link frames. [S, 4] each.
    """

    light: SkyLight | None
    robot: Mapping[str, Array]

    @classmethod
    def read(cls, path: str | Path) -> LightFile:
        """Read the record of the stage.

        Raises:
            InputError: The file is missing or damaged.
        """
        content = read_json(path)
        try:
            robot = {name: np.array(spheres, dtype=np.float64).reshape(-1, 4) for name, spheres in content["robot"].items()}
            light = content["light"]
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(path, f"the light is damaged ({error!r})", "Delete it and calibrate again") from error
        return cls(None if light is None else SkyLight.of(light, str(path)), robot)

    def shadows(self, name: str, item: Asset) -> Shadows | None:
        """Return the shadows of the robot and of an object called `name`; None without a light."""
        if self.light is None:
            return None
        return Shadows(self.light, self.robot, (name, spheres_in(item.mesh(), OBJECT_SPHERES)))
