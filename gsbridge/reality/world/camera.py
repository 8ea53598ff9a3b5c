"""The wrist camera: path-traced pictures of the true object, table, plate and robot, through a sensor with noise.

The scene is loaded once. Bodies that move are instances of shape groups, so that a new frame changes transforms only. This
takes much less time than new vertices for every shape. Most of the remaining time grows with the number of all triangles,
moving or not, because Mitsuba sorts them all again. Object and plate are therefore meshed at twice the vertex spacing of the
films, which is still below one pixel of a wrist image.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.capture.printing import sheet_reflectance
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.board import standard_board
from gsbridge.reality.mirror import studio  # its private parts too: an edit there would make every film stale
from gsbridge.reality.mirror.backgrounds import BACKGROUNDS, TABLE_CENTRE_M, TABLE_SIZE_M, make_plate, table_texture
from gsbridge.reality.mirror.path_tracer import load_mitsuba, picture_maker
from gsbridge.reality.world.bodies import repainted, shown_mesh
from gsbridge.reality.world.coverage import points_seen, shows
from gsbridge.reality.world.electronics import Electronics, LensError
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.surfaces import coated, filled, painted
from gsbridge.reality.world.surroundings import lying_about, window
from gsbridge.robot.assembly import RobotFiles

FIELD_OF_VIEW = np.deg2rad(42.5)
"""Field of view of the square picture, rad: that of the central square of a RealSense D435i's colour image, as in the paper."""

_NEAR, _FAR = 0.01, 20.0
_REST = 1.0
"""Time between photos of a scene at rest, s; exposure and white balance are already settled in the first photo."""
_SHEET_PIXELS_PER_M = 2000.0
_DETAIL = 2.0
"""Vertex spacing of the meshes of object and plate, as a multiple of the spacing in films."""
_GLOSSY_SHARE = 0.6
"""Factor on the number of samples in scenes with highlights at path depth 2, because each sample then sends a second ray."""
_SAMPLERS = ("multijitter", "stratified", "independent")
_COVERS = ("arm", "coloured", "hand")


@dataclass(frozen=True)
class Setting:
    """Background and object in the room.

    Args:
        object: One of the mirror's objects, or None.
        background: One of the mirror's backgrounds.
        sheet: Paper size of the board that lies on the table, as in the films; None without it.
        seed: Seed of textures and shapes, as in the films.
    """

    object: str | None = None
    background: str = "foam_pad"
    sheet: str | None = "a4"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.background not in BACKGROUNDS:
            raise InputError("mirror", f"the background '{self.background}' is unknown", f"Use one of {', '.join(BACKGROUNDS)}")


@dataclass(frozen=True)
class Quality:
    """Settings of the path tracer.

    Args:
        samples: Least number of samples per pixel; the default sampler rounds it up, for example from 32 to 35.
        depth: Largest path length. The films use 4; at 3 the picture is slightly darker. 2 is direct light with shadows, found
            by rays to the lights alone; it is slightly darker again, and faster.
        sampler: Mitsuba's sampler; `independent` is faster and noisier.
    """

    samples: int = 32
    depth: int = 3
    sampler: str = "multijitter"

    def __post_init__(self) -> None:
        if self.samples < 1 or self.depth < 2 or self.sampler not in _SAMPLERS:
            raise InputError(
                "mirror camera", f"{self} gives no picture", f"At least 1 sample, depth 2, and one of {', '.join(_SAMPLERS)}"
            )


def wrist_camera(size: int) -> Camera:
    """Return the intrinsics of a square wrist picture of `size` px, with the principal point in the middle.

    Raises:
        InputError: The size is not positive.
    """
    if size < 1:
        raise InputError("mirror camera", f"a picture of {size} px cannot be taken", "Ask for at least 1 px")
    focal = size / 2 / np.tan(FIELD_OF_VIEW / 2)
    return Camera(size, size, focal, focal, size / 2, size / 2)


class MirrorCamera:
    """The room with everything in it, which can be photographed from any pose and with its bodies at any poses.

    Args:
        setting: Background, object and board in the room.
        robot: The robot; its links are drawn under the names of the description.
        hidden: Hidden parameters of light, colours and sensor.
        threads: Threads to render with.
    """

    def __init__(self, setting: Setting, robot: RobotFiles, hidden: Hidden, threads: int = 1) -> None:
        self.hidden = hidden
        self._mi = mi = load_mitsuba(threads)
        self._moved: dict[str, Array] = {}
        self._glossy = max(hidden.gloss_object, hidden.gloss_plate, hidden.gloss_robot, hidden.gloss_table) > 0.0
        self._glossy = self._glossy or hidden.clutter + hidden.decoys > 0.0
        self._lenses: dict[Camera, LensError] = {}
        content, colours = _room(mi, setting, hidden), None
        shapes = {name: [_link(mi, mesh, colour, hidden) for mesh, colour in items] for name, items in robot.visuals().items()}
        if setting.object is not None:
            mesh, normals = shown_mesh(setting.object, setting.seed, _DETAIL)
            shapes["object"] = [_object(mi, mesh, normals, hidden.gloss_object)]
            colours = mesh.colours
        if hidden.passer > 0.0:
            shapes["passer"] = [_link(mi, _screen(hidden.passer), (0.3, 0.3, 0.35), hidden)]
        content |= lying_about(mi, hidden, colours)
        for name, parts in shapes.items():
            group = f"group_{name}"
            content[group] = {"type": "shapegroup", **{f"part_{index}": part for index, part in enumerate(parts)}}
            content[f"body_{name}"] = {
                "type": "instance",
                # Keep the body out of sight until its pose is known.
                "to_world": mi.ScalarTransform4f().translate([0, 0, -50]),
                "group": {"type": "ref", "id": group},
            }
        self.bodies = tuple(shapes)
        # Without optimisation: it would merge shapes and order them by memory address, and the order of the lights changes the
        # samples, so pictures would not be reproducible.
        self._scene = mi.load_dict(content, optimize=False)
        self._parameters = mi.traverse(self._scene)
        self._parameters.keep([f"body_{name}.to_world" for name in shapes])
        self._sensors: dict[tuple[Camera, Quality, int, int], tuple[Any, Any]] = {}
        self._makers: dict[tuple[Camera, Quality, tuple[int, int] | None], Callable[[int], Array]] = {}

    def move(self, poses: Mapping[str, Array]) -> None:
        """Set the poses of bodies.

        Args:
            poses: `table_from_body` by name; names of bodies that are not drawn are ignored. Each [4, 4].
        """
        for name in self.bodies:
            if name in poses and (name not in self._moved or not np.array_equal(self._moved[name], poses[name])):
                self._moved[name] = np.array(poses[name])
                self._parameters[f"body_{name}.to_world"] = self._mi.ScalarTransform4f(self._moved[name])
        self._parameters.update()

    def light(
        self, camera: Camera, cam_from_table: Array, quality: Quality, seed: int, rows: tuple[int, int] | None = None
    ) -> Array:
        """Render the linear light that arrives at the sensor. [H, W, 3] float32.

        Args:
            camera: Pinhole with square pixels and its principal point in the middle.
            cam_from_table: Pose of the camera, OpenCV axes. [4, 4].
            quality: Samples and depth.
            seed: Seed of the samples.
            rows: First row, and the row after the last, of the part to render; None for the whole picture.
        """
        if self._glossy and quality.depth == 2:
            quality = replace(quality, samples=max(1, round(_GLOSSY_SHARE * quality.samples)))
        sensor, key = self._sensor(camera, cam_from_table, quality, rows), (camera, quality, rows)
        if key not in self._makers:
            integrator = _integrator(quality.depth, self._glossy)
            self._makers[key] = picture_maker(self._mi, self._scene, sensor, integrator)
        return self._makers[key](seed)[..., :3]

    def coverage(self, camera: Camera, cam_from_table: Array, names: tuple[str, ...], samples: int = 16) -> Array:
        """Return the share of each pixel in which the bodies are visible; hidden parts do not count. [H, W] float32.

        Args:
            camera: The camera, see `light`.
            cam_from_table: Pose of the camera. [4, 4].
            names: Names of the bodies.
            samples: Samples per pixel, rounded to a square number.

        Raises:
            InputError: A body is not drawn.
        """
        for name in names:
            if name not in self.bodies:
                raise InputError("mirror camera", f"the body '{name}' is not drawn", f"Use one of {', '.join(self.bodies)}")
        # Trace one ray per pixel of an enlarged picture: bodies' numbers must not be averaged within a pixel.
        fine = camera.scaled(max(1, round(np.sqrt(samples))))
        sensor = self._sensor(fine, cam_from_table, Quality(1))
        hit = shows(self._mi, self._scene, sensor, fine, {f"body_{name}" for name in names}).astype(np.float32)
        step = fine.width // camera.width
        return hit.reshape(camera.height, step, camera.width, step).mean((1, 3))

    def seen_points(self, camera: Camera, cam_from_table: Array) -> Array:
        """Return the points that the pixels show, as `points_seen` does, from a pose of the camera. [4, 4] -> [H, W, 3]."""
        return points_seen(self._mi, self._scene, self._sensor(camera, cam_from_table, Quality(1)))

    def lens(self, camera: Camera) -> LensError | None:
        """Return the lens errors that remain after calibration; None if there are none."""
        if self.hidden.distortion == 0.0 and self.hidden.focal_error == 0.0:
            return None
        if camera not in self._lenses:
            self._lenses[camera] = LensError(camera, self.hidden)
        return self._lenses[camera]

    def photo(self, camera: Camera, cam_from_table: Array, quality: Quality, seed: int) -> Array:
        """Take a photo of a scene at rest, with exposure and white balance settled.

        Args:
            camera: Pinhole with square pixels and its principal point in the middle.
            cam_from_table: Pose of the camera, OpenCV axes. [4, 4].
            quality: Samples and depth.
            seed: Seed of the samples and the sensor's noise.

        Returns:
            sRGB. [H, W, 3] uint8.
        """
        lens, electronics = self.lens(camera), Electronics(self.hidden, _REST)
        light = self.light(camera if lens is None else lens.wide, cam_from_table, quality, seed)
        light = light if lens is None else lens(light)
        return electronics.delivered(expose(light, self.hidden, np.random.default_rng([seed, 2]), electronics.gains(light)))

    def _sensor(self, camera: Camera, cam_from_table: Array, quality: Quality, rows: tuple[int, int] | None = None) -> Any:
        """Return a Mitsuba sensor at a pose; sensors with the same settings are made once and moved."""
        mi, (top, bottom) = self._mi, rows or (0, camera.height)
        key = camera, quality, top, bottom
        # Mitsuba looks along +z with x to the left and y up.
        to_world = mi.ScalarTransform4f(np.linalg.inv(cam_from_table) @ np.diag([-1.0, -1.0, 1.0, 1.0]))
        if key not in self._sensors:
            sensor = mi.load_dict(
                {
                    "type": "perspective",
                    "fov": float(np.degrees(2 * np.arctan(camera.width / 2 / camera.fx))),
                    "fov_axis": "x",
                    "near_clip": _NEAR,
                    "far_clip": _FAR,
                    "to_world": to_world,
                    "film": {
                        "type": "hdrfilm",
                        "width": camera.width,
                        "height": camera.height,
                        **({} if rows is None else _cropped(camera.width, *rows)),
                        "rfilter": {"type": "box"},
                        "pixel_format": "rgb",
                        "component_format": "float32",
                    },
                    "sampler": {"type": quality.sampler, "sample_count": quality.samples},
                }
            )
            self._sensors[key] = sensor, mi.traverse(sensor)
        sensor, parameters = self._sensors[key]
        parameters["to_world"] = to_world
        parameters.update()
        return sensor


def _cropped(width: int, top: int, bottom: int) -> dict[str, int]:
    """Return the crop of a Mitsuba film to the rows from `top` up to, but without, `bottom`."""
    return {"crop_offset_x": 0, "crop_offset_y": top, "crop_width": width, "crop_height": bottom - top}


def _integrator(depth: int, glossy: bool) -> dict[str, Any]:
    """Return Mitsuba's integrator for paths up to a length."""
    if depth == 2:
        # On diffuse surfaces, rays sent to the lights have less noise than rays in random directions (BSDF samples); only
        # highlights need the latter.
        return {"type": "direct", "emitter_samples": 1, "bsdf_samples": int(glossy)}
    return {"type": "path", "max_depth": depth, "rr_depth": 8}


def expose(light: Array, hidden: Hidden, rng: np.random.Generator, gains: Array | float = 1.0) -> Array:
    """Simulate the sensor: falloff, shot and readout noise in linear light, saturation, sRGB encoding, tint, 8 bits.

    Args:
        light: Linear light; 1 saturates at unit exposure. [H, W, 3].
        hidden: Hidden parameters of the sensor.
        rng: Source of the noise.
        gains: Gain of each channel: below 1 the sensor takes less light, above 1 signal and noise are amplified. [3], or one
            for all.

    Returns:
        The picture. uint8 [H, W, 3].
    """
    signal = np.maximum(np.asarray(light, dtype=np.float64) * (hidden.exposure * np.minimum(gains, 1.0)), 0.0)
    if hidden.vignette > 0.0:
        signal = signal * _falloff(signal.shape[0], signal.shape[1], hidden.vignette)[..., None]
    spread = np.sqrt(signal / hidden.full_well + hidden.read_noise**2)
    signal = np.clip((signal + spread * rng.standard_normal(signal.shape)) * np.maximum(gains, 1.0), 0.0, 1.0)
    encoded = srgb_from_linear(signal) * hidden.tint + hidden.pedestal
    return np.rint(255.0 * np.clip(encoded, 0.0, 1.0)).astype(np.uint8)


def _falloff(height: int, width: int, lost: float) -> Array:
    """Return the share of the light that reaches each pixel by the cosine-fourth law. [H, W].

    Args:
        height, width: Size of the picture, px.
        lost: Share lost at the outer corners of the corner pixels.
    """
    y, x = (np.arange(height) + 0.5) / height * 2 - 1, (np.arange(width) + 0.5) / width * 2 - 1
    # Squared distance from the centre, 1 at the corners, where the law (cos^4 = (1 + tan^2)^-2) is scaled to lose `lost`.
    square = (x**2 * width**2 + (y**2)[:, None] * height**2) / (width**2 + height**2)
    return (1.0 + ((1.0 - lost) ** -0.5 - 1.0) * square) ** -2.0


def _room(mi: Any, setting: Setting, hidden: Hidden) -> dict[str, Any]:
    """Describe table, board, plate, floor and light: the films' studio, with its light changed by the hidden parameters."""
    eye, aim = lamp_line(hidden)
    lamp = mi.ScalarTransform4f().look_at(origin=eye.tolist(), target=aim.tolist(), up=[0, 0, 1])
    power = hidden.light_power * np.array(hidden.light_cast)
    if hidden.light_hue != 0.0:
        power = power * np.exp([hidden.light_hue, 0.0, -hidden.light_hue])
    radiance = studio._LIGHT_RADIANCE * power * (1.03, 1.0, 0.95)
    sky = studio._SKY_RADIANCE * power * (0.95, 1.0, 1.08)
    bulb = {
        "type": "rectangle",
        "to_world": lamp.scale([studio._LIGHT_HALF] * 3),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": ((1.0 - hidden.lamp_dim) * radiance).tolist()}},
    }
    content: dict[str, Any] = {
        "type": "scene",
        "table": studio._picture(
            mi, table_texture(setting.background, setting.seed), TABLE_CENTRE_M, TABLE_SIZE_M, -studio._PAPER_THICKNESS
        ),
        "floor": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().translate([0, 0, -0.75]).scale([3, 3, 1]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.22, 0.17, 0.13]}},
        },
        **({"light": bulb} if hidden.lamp_dim < 1.0 else {}),
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": sky.tolist()}, "sampling_weight": 0.4},
        **window(mi, hidden, float(studio._LIGHT_RADIANCE * hidden.light_power)),
    }
    if hidden.gloss_table > 0.0:
        content["table"]["bsdf"] = coated(content["table"]["bsdf"]["reflectance"], hidden.gloss_table)
    if setting.sheet is not None:
        board = standard_board(setting.sheet)
        paper = studio._INK + (studio._PAPER - studio._INK) * sheet_reflectance(board, _SHEET_PIXELS_PER_M)
        content["sheet"] = studio._picture(mi, np.repeat(paper[..., None], 3, axis=2), (0.0, 0.0), board.size, 0.0)
    if setting.background == "plate":
        plate, normals = make_plate(setting.seed, _DETAIL)
        plate = repainted(plate, make_plate(setting.seed)[0])
        content["plate"] = painted(mi, "plate", *studio.placed(plate, normals, studio.PLATE_CENTRE_M, 0.0), hidden.gloss_plate)
    return content


def lamp_line(hidden: Hidden) -> tuple[Array, Array]:
    """Return the position of the lamp and the point at which it is aimed, table frame, m. [3], [3]."""
    aim = np.array(studio._LIGHT_AIM)
    return aim + _swing(np.array(studio._LIGHT_EYE) - aim, hidden.light_turn, hidden.light_rise), aim


def _screen(half: float) -> Mesh:
    """Return the screen that represents a person, own frame: `half` is half its width, m; 0.6 m high, with two faces."""
    corners = np.array([[-half, -0.3, 0.0], [half, -0.3, 0.0], [half, 0.3, 0.0], [-half, 0.3, 0.0]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]))


def _swing(arm: Array, turn: float, rise: float) -> Array:
    """Turn a vector about the vertical by `turn` and raise it by `rise`, rad; its length stays the same. [3]."""
    length, level = np.linalg.norm(arm), np.hypot(arm[0], arm[1])
    heading, height = np.arctan2(arm[1], arm[0]) + turn, np.arctan2(arm[2], level) + rise
    return length * np.array([np.cos(height) * np.cos(heading), np.cos(height) * np.sin(heading), np.sin(height)])


def _link(mi: Any, mesh: Mesh, colour: tuple[float, float, float], hidden: Hidden) -> Any:
    """Return the Mitsuba mesh of a part of the robot, flat-shaded, in its true colour."""
    group = "hand" if max(colour) < 0.5 else "coloured" if max(colour) - min(colour) > 0.2 else "arm"
    shade = hidden.robot_shade[_COVERS.index(group)]
    reflectance = np.clip(linear_from_srgb(np.array(colour)) * shade * hidden.robot_tint, 0.0, 0.9)
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(coated({"type": "rgb", "value": reflectance.tolist()}, hidden.gloss_robot))
    return filled(mi, mi.Mesh("link", len(mesh.vertices), len(mesh.faces), props=properties), mesh)


def _object(mi: Any, mesh: Mesh, normals: Array, gloss: float) -> Any:
    """Return the Mitsuba mesh of the object, with one colour per triangle.

    Vertex colours are wrong on an instance: to interpolate, Mitsuba 3.9 compares a point in the world frame with vertices in
    the mesh's own frame. One colour per triangle is enough, because triangles are half a pixel or less.
    """
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(coated({"type": "mesh_attribute", "name": "face_color"}, gloss))
    shape = mi.Mesh("object", len(mesh.vertices), len(mesh.faces), has_vertex_normals=True, props=properties)
    shape.add_attribute("face_color", 3, np.asarray(mesh.colours)[mesh.faces].mean(1).astype(np.float32).ravel())
    return filled(mi, shape, mesh, normals)
