"""The film set: object, table, board, light and camera as a Mitsuba scene, rendered in linear light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.capture.printing import sheet_reflectance
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.board import standard_board
from gsbridge.reality.mirror.backgrounds import (
    BACKGROUNDS,
    PLATE_CENTRE_M,
    TABLE_CENTRE_M,
    TABLE_SIZE_M,
    make_plate,
    table_texture,
)
from gsbridge.reality.mirror.objects import OBJECTS, make_object
from gsbridge.reality.mirror.path import OBJECT_SPOT_M
from gsbridge.reality.mirror.path_tracer import load_mitsuba, without_failed_pixels

_SHEET_PIXELS_PER_M = 4000.0
_PAPER, _INK = 0.80, 0.03  # reflectances
_PAPER_THICKNESS = 1e-4  # m; the sheet's face is z = 0, the table lies this far below
_LIGHT_EYE, _LIGHT_AIM, _LIGHT_HALF, _LIGHT_RADIANCE = (0.55, -0.30, 1.15), (0.0, 0.15, 0.0), 0.5, 4.1
_SKY_RADIANCE = 0.2

# Scene name -> object, background, yaw of the object in degrees.
SCENES: dict[str, tuple[str | None, str, float]] = {
    "small_cube": ("small_cube", "foam_pad", 24.0),
    "cake": ("cake", "foam_pad", -15.0),
    "banana": ("banana", "tablecloth", 12.0),
    "bear": ("bear", "foam_pad", 8.0),
    "foam_pad": (None, "foam_pad", 0.0),
    "tablecloth": (None, "tablecloth", 0.0),
    "plate": (None, "plate", 0.0),
    "mug": ("mug", "foam_pad", -35.0),
    "bowl": ("bowl", "tablecloth", 0.0),
    "pot": ("pot", "foam_pad", 0.0),
    "statue": ("statue", "tablecloth", 20.0),
    "toy": ("toy", "foam_pad", -25.0),
    "white_box": ("white_box", "tablecloth", 30.0),
    "dense_pan": ("small_cube", "foam_pad", 24.0),
}
"""Scenes that can be filmed in the studio."""


def placed(mesh: Mesh, normals: Array, spot: tuple[float, float], yaw_deg: float) -> tuple[Mesh, Array]:
    """Turn a mesh and its normals about z and move the mesh to a spot on the table.

    Args:
        mesh: Mesh in its own frame, m.
        normals: Vertex normals of the mesh. [V, 3].
        spot: x and y on the table, m.
        yaw_deg: Turn about z, degrees.

    Returns:
        The mesh and its normals, table frame.
    """
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    return Mesh(mesh.vertices @ turn.T + [*spot, 0.0], mesh.faces, mesh.colours), normals @ turn.T


def _painted_mesh(mi: Any, name: str, mesh: Mesh, normals: Array) -> Any:
    """Return a Mitsuba mesh with vertex colours as diffuse reflectance."""
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(
        {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}
    )
    shape = mi.Mesh(name, len(mesh.vertices), len(mesh.faces), has_vertex_normals=True, props=properties)
    shape.add_attribute("vertex_color", 3, np.asarray(mesh.colours, dtype=np.float32).ravel())
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = np.asarray(mesh.vertices, dtype=np.float32).ravel()
    parameters["vertex_normals"] = np.asarray(normals, dtype=np.float32).ravel()
    parameters["faces"] = np.asarray(mesh.faces, dtype=np.uint32).ravel()
    parameters.update()
    return shape


def _picture(mi: Any, reflectance: Array, centre: tuple[float, float], size: tuple[float, float], z: float) -> dict[str, Any]:
    """Describe a flat rectangle that faces up and shows a picture, with the picture's first row at the +y edge."""
    to_world = mi.ScalarTransform4f().translate([*centre, z]).scale([size[0] / 2, size[1] / 2, 1])
    bitmap = mi.Bitmap(np.ascontiguousarray(reflectance[::-1], dtype=np.float32))  # v runs up
    texture = {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "bilinear", "wrap_mode": "clamp"}
    return {"type": "rectangle", "to_world": to_world, "bsdf": {"type": "diffuse", "reflectance": texture}}


@dataclass(frozen=True)
class Studio:
    """A lit set, ready to be rendered from any pose.

    Args:
        mi: The Mitsuba module.
        scene: The whole lit scene.
        alone: A scene with the object alone, for its mask; None without an object.
        truth: True mesh, table frame, m, with linear colours if it has any: the object, or the table top with the plate on it.
    """

    mi: Any
    scene: Any
    alone: Any | None
    truth: Mesh

    def _sensor(
        self, camera: Camera, cam_from_table: Array, samples: int, window: tuple[int, int, int, int] | None = None
    ) -> Any:
        """Return a Mitsuba sensor; with a `window` (left, top, width, height, px) only for that part, with coverage as alpha.

        A window is a separate camera with another principal point. A crop of the film would be a constant in Mitsuba's kernels,
        which would then be compiled again for every picture; that takes longer than rendering.
        """
        mi = self.mi
        left, top, width, height = window or (0, 0, camera.width, camera.height)
        # Mitsuba looks along +z with x to the left and y up.
        to_world = np.linalg.inv(cam_from_table) @ np.diag([-1.0, -1.0, 1.0, 1.0])
        return mi.load_dict(
            {
                "type": "perspective",
                "fov": float(np.degrees(2 * np.arctan(width / 2 / camera.fx))),
                "fov_axis": "x",
                "principal_point_offset_x": (2 * left + width - camera.width) / 2 / width,
                "principal_point_offset_y": (2 * top + height - camera.height) / 2 / height,
                "near_clip": 0.02,
                "far_clip": 20.0,
                "to_world": mi.ScalarTransform4f(to_world),
                "film": {
                    "type": "hdrfilm",
                    "width": width,
                    "height": height,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgba" if window else "rgb",
                    "component_format": "float32",
                },
                "sampler": {"type": "multijitter", "sample_count": samples},
            }
        )

    def render(self, camera: Camera, cam_from_table: Array, samples: int, seed: int) -> Array:
        """Render a path-traced picture in linear light. [h, w, 3] float32.

        Args:
            camera: Pinhole with its principal point in the middle.
            cam_from_table: Pose of the camera, OpenCV axes. [4, 4].
            samples: Samples per pixel.
            seed: Seed of the samples.
        """
        sensor = self._sensor(camera, cam_from_table, samples)
        integrator = self.mi.load_dict({"type": "path", "max_depth": 4, "rr_depth": 8})
        picture = self.mi.render(self.scene, sensor=sensor, integrator=integrator, seed=seed, spp=samples)
        return without_failed_pixels(np.array(picture)[..., :3])

    def coverage(self, camera: Camera, cam_from_table: Array, samples: int = 16) -> Array:
        """Render the share of each pixel that shows the object. [h, w] float32.

        Args:
            camera: Pinhole with its principal point in the middle.
            cam_from_table: Pose of the camera. [4, 4].
            samples: Samples per pixel.
        """
        out = np.zeros((camera.height, camera.width), np.float32)
        if self.alone is None:
            return out
        # Only the object's part of the picture is rendered, which takes a tenth of the time.
        pixels = camera.project(self.truth.vertices[::16] @ cam_from_table[:3, :3].T + cam_from_table[:3, 3])
        low = np.clip(np.floor(pixels.min(0)).astype(int) - 6, 0, [camera.width - 1, camera.height - 1])
        high = np.clip(np.ceil(pixels.max(0)).astype(int) + 6, low + 1, [camera.width, camera.height])
        (left, top), (width, height) = self._window(low, high, camera)
        sensor = self._sensor(camera, cam_from_table, samples, (left, top, width, height))
        integrator = self.mi.load_dict({"type": "direct", "hide_emitters": True})
        cover = np.array(self.mi.render(self.alone, sensor=sensor, integrator=integrator, seed=0, spp=samples))[..., 3]
        out[top : top + height, left : left + width] = cover
        return out

    @staticmethod
    def _window(low: Array, high: Array, camera: Camera) -> tuple[tuple[int, int], tuple[int, int]]:
        """Return left and top, width and height, px, of a window that contains some pixels.

        Only a few sizes are used, because Mitsuba compiles kernels for each.

        Args:
            low: First column and row. [2].
            high: Column and row after the last. [2].
            camera: Camera of the picture.
        """
        whole = np.array([camera.width, camera.height])
        step = -(-whole // 4)
        size = np.minimum(-(-(high - low) // step) * step, whole)
        left, top = np.minimum(low, whole - size).tolist()
        width, height = size.tolist()
        return (left, top), (width, height)


def _table_mesh(cell: float = 0.01) -> Mesh:
    """Return the bare table top as a grid of triangles that face up."""
    counts = [round(side / cell) for side in TABLE_SIZE_M]
    x = np.linspace(-0.5, 0.5, counts[0] + 1) * TABLE_SIZE_M[0] + TABLE_CENTRE_M[0]
    y = np.linspace(-0.5, 0.5, counts[1] + 1) * TABLE_SIZE_M[1] + TABLE_CENTRE_M[1]
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    index = np.arange(grid[..., 0].size).reshape(grid.shape[:2])
    a, b, c, d = index[:-1, :-1].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    vertices = np.c_[grid.reshape(-1, 2), np.zeros(index.size)]
    return Mesh(vertices, np.concatenate([np.c_[a, b, c], np.c_[a, c, d]]))


def build_studio(scene: str, sheet: str, threads: int, seed: int) -> Studio:
    """Build the set of a film.

    Args:
        scene: One of `SCENES`.
        sheet: Paper size of the board.
        threads: Threads to render with.
        seed: Seed of the world's textures. Films of one seed share tables and objects.

    Raises:
        InputError: The scene is unknown.
    """
    if scene not in SCENES:
        raise InputError("mirror", f"the scene '{scene}' is unknown", f"Use one of {', '.join(SCENES)}")
    name, background, yaw = SCENES[scene]
    mi = load_mitsuba(threads)
    board = standard_board(sheet)
    paper = _INK + (_PAPER - _INK) * sheet_reflectance(board, _SHEET_PIXELS_PER_M)
    to_light = mi.ScalarTransform4f().look_at(origin=_LIGHT_EYE, target=_LIGHT_AIM, up=[0, 0, 1]).scale([_LIGHT_HALF] * 3)
    content: dict[str, Any] = {
        "type": "scene",
        "table": _picture(mi, table_texture(background, seed), TABLE_CENTRE_M, TABLE_SIZE_M, -_PAPER_THICKNESS),
        "sheet": _picture(mi, np.repeat(paper[..., None], 3, axis=2), (0.0, 0.0), board.size, 0.0),
        "floor": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().translate([0, 0, -0.75]).scale([3, 3, 1]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.22, 0.17, 0.13]}},
        },
        "light": {
            "type": "rectangle",
            "to_world": to_light,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [_LIGHT_RADIANCE * c for c in (1.03, 1.0, 0.95)]}},
        },
        "sky": {
            "type": "constant",
            "radiance": {"type": "rgb", "value": [_SKY_RADIANCE * c for c in (0.95, 1.0, 1.08)]},
            "sampling_weight": 0.4,
        },
    }
    alone = None
    truth = _table_mesh()
    shown: tuple[Mesh, Array] | None = None
    if name is not None:
        mesh, normals = make_object(name, seed)
        shown = placed(mesh, normals, OBJECT_SPOT_M, yaw)
        truth = shown[0]
        alone = mi.load_dict({"type": "scene", "object": _painted_mesh(mi, "object", *shown)})
    elif background == "plate":
        plate, normals = make_plate(seed)
        shown = placed(plate, normals, PLATE_CENTRE_M, 0.0)
        vertices = np.vstack([truth.vertices, shown[0].vertices])
        truth = Mesh(vertices, np.vstack([truth.faces, shown[0].faces + len(truth.vertices)]))
    if shown is not None:
        content["object"] = _painted_mesh(mi, "object", *shown)
    return Studio(mi, mi.load_dict(content), alone, truth)


__all__ = ["BACKGROUNDS", "OBJECTS", "SCENES", "Studio", "build_studio", "placed"]
