"""Builders of environments from the files of a rule. They can be pickled, since every process builds its own environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.asset.bundle import Asset, read_asset
from gsbridge.configuration.renderers import SHADED, SPLATS
from gsbridge.environment.controllers import GraspController, PlaceController, grip_of, rim_grip, stable_gain
from gsbridge.environment.env import PickEnvironment
from gsbridge.environment.gaussian_renderer import OBJECT, GaussianRenderer
from gsbridge.environment.lens import WristLens
from gsbridge.environment.light import LightFile
from gsbridge.environment.litter import Litter
from gsbridge.environment.mesh_renderer import MeshRenderer, mean_mesh_colour
from gsbridge.environment.photometry import Photometry, read_photometry
from gsbridge.environment.rendering import Renderer, wrist_camera
from gsbridge.environment.robot_splats import link_meshes, read_robot_splats
from gsbridge.environment.settings import EnvironmentSettings, Plate
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.geometry import Array, Similarity
from gsbridge.robot.assembly import RobotFiles
from gsbridge.sim.camera import CameraResponse
from gsbridge.sim.engine import Item
from gsbridge.sim.model import CameraModel, read_model
from gsbridge.sim.world import SimWorld
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.ply import read_ply
from gsbridge.tasks.rules import Place
from gsbridge.tasks.world import CONTROL_HZ

OPTIONAL = ("robot_splats", "registration", "photometry", "light", "item_splats", "background_splats")
"""Files that not every environment has."""


@dataclass(frozen=True)
class StageFiles:
    """Files that a simulated environment is made of.

    Args:
        robot: Folder of the robot's description.
        item: `asset.json` of the object.
        background: `asset.json` of the background; what stands up from it is a static body, too.
        model: The simulation model, YAML.
        robot_splats: Folder of the links' splats (`write_robot_splats`); only `gs` reads it.
        registration: `registration.json` with `base_from_table`; None for the nominal place of the table.
        photometry: Response of the wrist camera and colours of the hand (`gsbridge.environment.photometry`); None for a camera
            that sees what the phone saw, and a robot in its description's colours.
        light: Light over the table (`gsbridge.environment.light`), for shadows in the pictures of `SHADED` renderers; None for
            no shadows.
        item_splats, background_splats: Splats of the soft binding, table frames of their films; only `gs_soft` uses them.
        item_colour, background_colour: Mean colours of the photos inside their masks, sRGB 0..1; only `mesh` uses them; None
            for the meshes' means. [3].
    """

    robot: str | Path
    item: str | Path
    background: str | Path
    model: str | Path
    robot_splats: str | Path | None = None
    registration: str | Path | None = None
    photometry: str | Path | None = None
    light: str | Path | None = None
    item_splats: str | Path | None = None
    background_splats: str | Path | None = None
    item_colour: tuple[float, float, float] | None = None
    background_colour: tuple[float, float, float] | None = None

    @classmethod
    def of(cls, inputs: Mapping[str, str], item_colour: tuple[float, float, float] | None = None) -> StageFiles:
        """Take the files from a rule's inputs, which have these names; files that the rule does without are None."""
        named: dict[str, Any] = {name: inputs.get(name) for name in OPTIONAL}
        named |= {name: inputs[name] for name in ("robot", "item", "background", "model")}
        return cls(**named, item_colour=item_colour)


def build_renderer(files: StageFiles, settings: EnvironmentSettings) -> Renderer:
    """The renderer that the settings ask for.

    Raises:
        InputError: A file is missing or of the wrong kind.
    """
    item, background = _asset(files.item, "object"), _asset(files.background, "background")
    camera = lens_of(files, settings).camera
    shadows = None
    if files.light is not None and settings.renderer in SHADED:
        shadows = LightFile.read(files.light).shadows(OBJECT, item)
    if settings.renderer in SPLATS:
        if files.robot_splats is None:
            raise InputError("robot splats", "the renderer draws the robot as splats", "Give their folder")
        links = read_robot_splats(files.robot_splats)
        clouds = item.cloud(), background.cloud()
        if settings.renderer == "gs_soft":
            clouds = _other_splats(item, files.item_splats), _other_splats(background, files.background_splats)
        return GaussianRenderer(*clouds, links, camera, surface=background.mesh(), shadows=shadows)
    return MeshRenderer(
        item.mesh(),
        background.mesh(),
        link_meshes(RobotFiles.read(files.robot), _photometry(files).robot_colours),
        camera,
        vertex_colours=settings.renderer in ("mesh_vertex", "mesh_vertex_shaded"),
        item_colour=files.item_colour,
        background_colour=files.background_colour,
        shadows=shadows,
    )


def build_environment(
    files: StageFiles, settings: EnvironmentSettings, *, litter: int = 0, latency: float = 0.0
) -> PickEnvironment:
    """An environment in the simulated world.

    Args:
        files: Files that it is made of.
        settings: Its settings.
        litter: Largest number of flat things that lie about in an episode's pictures; see `Litter`.
        latency: Longest dead time of commands beyond the model's, s; see `SimWorld`.

    Raises:
        InputError: A file is missing, of the wrong kind or damaged; the object does not fit the gripper; the start region is
            out of reach; the model has another control rate than policies.
    """
    world = build_world(files, latency=latency)
    renderer = build_renderer(files, settings)
    stroke, response, lens = world.dimensions.stroke, camera_response(files), lens_of(files, settings)
    scattered = Litter(litter, _palette(files, settings), settings.region()) if litter else None
    return PickEnvironment(world, settings, renderer, stroke=stroke, response=response, lens=lens, litter=scattered)


def _palette(files: StageFiles, settings: EnvironmentSettings) -> Array:
    """Colours of the object as the renderer shows it. [N, 3]."""
    asset = _asset(files.item, "object")
    if settings.renderer in SPLATS:
        return np.asarray(asset.cloud().colours, np.float64).clip(0.0, 1.0)
    mesh = asset.mesh()
    if settings.renderer in ("mesh", "mesh_shaded"):
        return np.array([mean_mesh_colour(mesh) if files.item_colour is None else files.item_colour])
    if mesh.colours is None:
        raise InputError(files.item, "the mesh has no vertex colours", "Build the asset again")
    return np.asarray(mesh.colours, np.float64)


def lens_of(files: StageFiles, settings: EnvironmentSettings) -> WristLens:
    """Return the lens that applies the model's image effects to the pictures."""
    return WristLens(read_model(files.model).effects_on("camera"), wrist_camera(settings.image_size))


def camera_response(files: StageFiles) -> CameraModel:
    """Return the wrist camera's response to a rendered picture: the calibrated one with the model's changes on top."""
    return _photometry(files).response.after(read_model(files.model).camera)


def build_world(files: StageFiles, *, latency: float = 0.0) -> SimWorld:
    """Build the simulated world, without a renderer.

    Args:
        files: Files that it is made of.
        latency: Longest dead time of commands beyond the model's, s; see `SimWorld`.

    Raises:
        InputError: As `build_environment`.
    """
    model = read_model(files.model)
    if model.timing.control_hz != CONTROL_HZ:
        raise InputError(
            files.model,
            f"timing.control_hz is {model.timing.control_hz:g}, but policies and controllers act {CONTROL_HZ} times a second, "
            "and tasks are judged as often",
            f"Set it to {CONTROL_HZ}",
        )
    return SimWorld(
        RobotFiles.read(files.robot),
        Item.of(_asset(files.item, "object"), files.item),
        model,
        base_from_table=_base_from_table(files.registration),
        plate=_asset(files.background, "background").relief_urdf,
        latency=latency,
    )


def plate_of(item: str | Path, background: str | Path) -> Plate | None:
    """Return the plate of a background, with room for the object beside it; None for a flat background.

    Args:
        item: `asset.json` of the object.
        background: `asset.json` of the background.

    Raises:
        InputError: A file is damaged or of the wrong kind.
    """
    relief = _asset(background, "background").relief
    if relief is None:
        return None
    reach = float(np.linalg.norm(Item.of(_asset(item, "object"), item).points[:, :2], axis=1).max())
    return Plate(relief.x, relief.y, relief.height, relief.radius + reach)


def environment_makers(
    files: StageFiles, settings: EnvironmentSettings, count: int, *, litter: int = 0, latency: float = 0.0
) -> Sequence[Callable[[], PickEnvironment]]:
    """Return functions that build one environment each, as gymnasium's vector environments take them.

    Args:
        files: Files of the stages that the environment is made of.
        settings: Settings of every environment.
        count: Number of environments, one per process.
        litter, latency: See `build_environment`.
    """
    return [partial(build_environment, files, settings, litter=litter, latency=latency) for _ in range(count)]


def build_controller(
    item: str | Path, settings: EnvironmentSettings, stroke: float = 0.14, *, delay: float = 0.0
) -> GraspController:
    """The baseline controller of the settings' task for an object.

    Args:
        item: `asset.json` of the object.
        settings: Task and action scale.
        stroke: Largest opening of the gripper, m.
        delay: Delay of commands, control periods. With a longer delay the controller corrects errors more slowly.
    """
    asset = _asset(item, "object")
    assert asset.properties is not None
    points = Item.of(asset, item).points
    grip = grip_of(points, asset.properties.centre) if asset.rim is None else rim_grip(asset.rim, float(points[:, 2].max()))
    rules = settings.rules()
    gain = stable_gain(delay)
    if isinstance(rules, Place):
        return PlaceController(grip, settings.action_scale(), stroke=stroke, gain=gain, task=rules)
    return GraspController(grip, settings.action_scale(), stroke=stroke, gain=gain)


def _asset(path: str | Path, kind: str) -> Asset:
    """An asset of one kind."""
    asset = read_asset(path)
    if asset.kind != kind:
        raise InputError(path, f"this asset is of the kind {asset.kind}", f"Name one of the kind {kind}")
    return asset


def _other_splats(asset: Asset, splats: str | Path | None) -> Cloud:
    """Read splats of the soft binding into an asset's body frame."""
    if splats is None:
        raise InputError("soft splats", "the renderer 'gs_soft' draws them", "Give those of object and background")
    return read_ply(splats).transformed(Similarity.from_matrix(asset.body_from_table))


def _photometry(files: StageFiles) -> Photometry:
    return Photometry(CameraResponse(), {}) if files.photometry is None else read_photometry(files.photometry)


def _base_from_table(registration: str | Path | None) -> Array | None:
    """Read `base_from_table` from the registration, if there is one. [4, 4] or None."""
    if registration is None:
        return None
    try:
        return np.array(read_json(registration)["base_from_table"], dtype=np.float64).reshape(4, 4)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(registration, f"it holds no base_from_table ({error})", "Run the registration again") from error
