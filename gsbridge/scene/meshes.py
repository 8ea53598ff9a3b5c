"""Images of meshes at the same camera and poses: the control without Gaussians (RL-sim).

The renderer is a z-buffer with perspective-correct colours, four samples per pixel and, if wanted, flat shading by one distant
light.
"""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.meshes import Mesh

NEAR = 0.01
"""Triangles are cut at this camera z, m."""

SAMPLES = 2
"""Samples per pixel and direction."""


@dataclass(frozen=True)
class Light:
    """A distant light plus ambient light; a face turned straight to the light shows its full colour.

    Args:
        direction: From the scene to the light, world frame. [3].
        ambient: Share of its colour that a face turned away shows, 0..1.
    """

    direction: tuple[float, float, float] = (0.3, 0.2, 1.0)
    ambient: float = 0.5


def mean_colour(images: Sequence[Array], masks: Sequence[Array]) -> Array:
    """Mean colour of the masked pixels of photos, averaged as light.

    Args:
        images: sRGB 0..1. [H, W, 3] each.
        masks: Weight of each pixel, 0..1. [H, W] each.

    Returns:
        sRGB 0..1. [3].

    Raises:
        ValueError: No pixel is masked.
    """
    weight = sum(float(mask.sum()) for mask in masks)
    if not weight > 0:
        raise ValueError("the masks hold no pixel")
    light = sum(
        np.einsum("hw,hwc->c", np.asarray(mask, np.float64), linear_from_srgb(np.asarray(image, np.float64)))
        for image, mask in zip(images, masks, strict=True)
    )
    return srgb_from_linear(np.asarray(light / weight))


def uniform(mesh: Mesh, colour: Array | Sequence[float]) -> Mesh:
    """The mesh in one colour, sRGB 0..1. [3]."""
    return Mesh(mesh.vertices, mesh.faces, np.tile(np.asarray(colour, np.float32), (len(mesh.vertices), 1)))


@njit(error_model="numpy")
def _fill(a: Array, b: Array, c: Array, ca: Array, cb: Array, cc: Array, inverse: Array, image: Array) -> None:
    """Draw a triangle in front of the camera.

    Args:
        a, b, c: Corners: u, v in samples, and 1 / z.
        ca, cb, cc: Colours at the corners, divided by z.
        inverse: 1 / z of the nearest surface. [H, W] float32.
        image: Colour of the nearest surface. [H, W, 3] float32.
    """
    height, width = inverse.shape
    area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
    if not abs(area) > 1e-12:
        return
    left, right = max(0.0, min(a[0], b[0], c[0]) - 0.5), min(width - 1.0, max(a[0], b[0], c[0]) - 0.5)
    top, bottom = max(0.0, min(a[1], b[1], c[1]) - 0.5), min(height - 1.0, max(a[1], b[1], c[1]) - 0.5)
    first = int(np.ceil(left))
    scale = 1.0 / area
    step_b, step_c = (c[1] - a[1]) * scale, -(b[1] - a[1]) * scale
    for row in range(int(np.ceil(top)), int(np.floor(bottom)) + 1):
        y, x = row + 0.5 - a[1], first + 0.5 - a[0]
        wb = (x * (c[1] - a[1]) - (c[0] - a[0]) * y) * scale
        wc = ((b[0] - a[0]) * y - x * (b[1] - a[1])) * scale
        for column in range(first, int(np.floor(right)) + 1):
            wa = 1.0 - wb - wc
            # A hair wider than exact, so that no sample falls between two neighbours.
            if wa >= -1e-9 and wb >= -1e-9 and wc >= -1e-9:
                nearness = np.float32(wa * a[2] + wb * b[2] + wc * c[2])
                if nearness > inverse[row, column]:
                    inverse[row, column] = nearness
                    z = 1.0 / nearness
                    for k in range(3):
                        image[row, column, k] = (wa * ca[k] + wb * cb[k] + wc * cc[k]) * z
            wb += step_b
            wc += step_c


@njit(error_model="numpy")
def _project(vertices: Array, starts: Array, poses: Array, pinhole: Array, points: Array, pixels: Array) -> None:
    """Camera coordinates of all vertices and, for those beyond the near plane, the pixel coordinates that `_fill` takes.

    Args:
        vertices: Body frames. [V, 3].
        starts: First vertex of each body, and one past the last. [B + 1].
        poses: Camera from body. [B, 4, 4].
        pinhole: fx, fy, cx, cy in samples.
        points: Filled. [V, 3].
        pixels: Filled with u, v and 1 / z. [V, 3].
    """
    fx, fy, cx, cy = pinhole
    for body in range(len(starts) - 1):
        m = poses[body]
        for index in range(starts[body], starts[body + 1]):
            x, y, z = vertices[index, 0], vertices[index, 1], vertices[index, 2]
            for i in range(3):
                points[index, i] = m[i, 0] * x + m[i, 1] * y + m[i, 2] * z + m[i, 3]
            if points[index, 2] >= NEAR:
                nearness = 1.0 / points[index, 2]
                pixels[index, 0] = fx * points[index, 0] * nearness + cx
                pixels[index, 1] = fy * points[index, 1] * nearness + cy
                pixels[index, 2] = nearness


@njit(error_model="numpy", forceinline=True)
def _tone(a: Array, b: Array, c: Array, light: Array, ambient: float) -> float:
    """Brightness of a face under a distant light, 0..1."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    if not length > 0.0:
        return 1.0
    # Open surfaces are seen from both sides, so the normal is turned to the camera.
    side = 1.0 if nx * a[0] + ny * a[1] + nz * a[2] < 0.0 else -1.0
    cosine = side * (nx * light[0] + ny * light[1] + nz * light[2]) / length
    return ambient + (1.0 - ambient) * max(cosine, 0.0)


@njit(error_model="numpy")
def _draw(
    points: Array,
    pixels: Array,
    colours: Array,
    faces: Array,
    pinhole: Array,
    light: Array,
    ambient: float,
    inverse: Array,
    image: Array,
) -> None:
    """Draw all faces.

    Args:
        points, pixels: As filled by `_project`.
        colours: [V, 3] float32.
        faces: Vertex indices. [F, 3].
        pinhole: fx, fy, cx, cy in samples.
        light: Unit direction to the light, camera axes; zeros for no shading. [3].
        ambient: See `Light`.
        inverse, image: See `_fill`.
    """
    fx, fy, cx, cy = pinhole
    height, width = inverse.shape
    shaded = light[0] != 0.0 or light[1] != 0.0 or light[2] != 0.0
    corner, paint = np.empty((4, 3)), np.empty((4, 3))
    for face in range(len(faces)):
        ia, ib, ic = faces[face, 0], faces[face, 1], faces[face, 2]
        behind = (points[ia, 2] < NEAR) + (points[ib, 2] < NEAR) + (points[ic, 2] < NEAR)
        if behind == 3:
            continue
        if behind == 0:
            ua, ub, uc = pixels[ia, 0], pixels[ib, 0], pixels[ic, 0]
            va, vb, vc = pixels[ia, 1], pixels[ib, 1], pixels[ic, 1]
            if (
                max(ua, ub, uc) < 0.5
                or min(ua, ub, uc) > width - 0.5
                or max(va, vb, vc) < 0.5
                or min(va, vb, vc) > height - 0.5
            ):
                continue
        tone = _tone(points[ia], points[ib], points[ic], light, ambient) if shaded else 1.0
        # Cutting the face at the near plane leaves a triangle or a quadrilateral.
        count = 0
        for k in range(3):
            i, j = faces[face, k], faces[face, (k + 1) % 3]
            if points[i, 2] >= NEAR:
                for n in range(3):
                    corner[count, n] = pixels[i, n]
                    paint[count, n] = colours[i, n] * tone * pixels[i, 2]
                count += 1
            if (points[i, 2] < NEAR) != (points[j, 2] < NEAR):
                t = (NEAR - points[i, 2]) / (points[j, 2] - points[i, 2])
                corner[count, 0] = fx * (points[i, 0] + t * (points[j, 0] - points[i, 0])) / NEAR + cx
                corner[count, 1] = fy * (points[i, 1] + t * (points[j, 1] - points[i, 1])) / NEAR + cy
                corner[count, 2] = 1.0 / NEAR
                for n in range(3):
                    paint[count, n] = (colours[i, n] + t * (colours[j, n] - colours[i, n])) * tone / NEAR
                count += 1
        for k in range(2, count):
            _fill(corner[0], corner[k - 1], corner[k], paint[0], paint[k - 1], paint[k], inverse, image)


@njit(error_model="numpy")
def _resolve(image: Array, samples: int, out: Array) -> None:
    """Mean of the samples of each pixel as 8 bits."""
    share = np.float32(255.0 / (samples * samples))
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            for k in range(3):
                total = np.float32(0.0)
                for j in range(samples):
                    for i in range(samples):
                        total += image[row * samples + j, column * samples + i, k]
                out[row, column, k] = np.uint8(min(max(total * share + np.float32(0.5), np.float32(0.0)), np.float32(255.0)))


class MeshComposition:
    """Meshes of a static background and of named bodies, packed once; the counterpart of `editing.Composition`.

    Args:
        bodies: Coloured mesh of each body, body frame. Bodies start at the world's origin.
        background: Coloured mesh of what never moves, world frame; None for nothing.

    Raises:
        ValueError: A mesh has no colours (see `uniform`).
    """

    def __init__(self, bodies: Mapping[str, Mesh], background: Mesh | None = None) -> None:
        meshes = ([] if background is None else [background]) + list(bodies.values())
        if any(mesh.colours is None for mesh in meshes):
            raise ValueError("every mesh needs colours; `uniform` paints one in a single colour")
        self.names = tuple(bodies)
        self._first = 0 if background is None else 1
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        self._vertices = np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in meshes)])
        self._colours = np.concatenate([np.zeros((0, 3)), *(mesh.colours for mesh in meshes)]).astype(np.float32)
        shifted = [mesh.faces + offset for mesh, offset in zip(meshes, offsets[:-1], strict=True)]
        self._faces = np.concatenate([np.zeros((0, 3), np.int64), *shifted]).astype(np.int32)
        self._starts = offsets.astype(np.int64)
        self._points, self._pixels = np.empty((2, *self._vertices.shape))
        self._poses = np.tile(np.eye(4), (len(meshes), 1, 1))

    def pose(self, world_from_body: Mapping[str, Array]) -> None:
        """Move bodies; the others stay where they are. [4, 4] each.

        Raises:
            KeyError: There is no such body.
        """
        for name, matrix in world_from_body.items():
            if name not in self.names:
                raise KeyError(f"there is no body {name!r}; there are {', '.join(self.names) or 'none'}")
            self._poses[self._first + self.names.index(name)] = matrix

    def render(
        self,
        camera: Camera,
        cam_from_world: Array,
        background: Sequence[float] = (0.0, 0.0, 0.0),
        *,
        light: Light | None = None,
        samples: int = SAMPLES,
    ) -> Array:
        """Image of the meshes as they are posed now.

        Args:
            camera: Pinhole.
            cam_from_world: Pose, OpenCV axes. [4, 4].
            background: Colour where there is no mesh, sRGB 0..1. [3].
            light: Shading; None shows the colours as they are (photo colours hold their light already).
            samples: Samples per pixel and direction.

        Returns:
            sRGB. [H, W, 3] uint8.

        Raises:
            ValueError: The camera has distortion.
        """
        image, _ = self._samples(camera, cam_from_world, background, light, samples)
        out = np.empty((camera.height, camera.width, 3), np.uint8)
        _resolve(image, samples, out)
        return out

    def draw(
        self, camera: Camera, cam_from_world: Array, background: Sequence[float] = (0.0, 0.0, 0.0), *, samples: int = SAMPLES
    ) -> tuple[Array, Array, Array]:
        """Draw the meshes as `gsbridge.scene.view.draw` draws splats: encoded colours, alpha, alpha-weighted sum of depth, m.

        Args:
            camera, cam_from_world, background, samples: As in `render`. [4, 4], [3].

        Returns:
            [H, W, 3], [H, W], [H, W] float32.

        Raises:
            ValueError: The camera has distortion.
        """
        image, inverse = self._samples(camera, cam_from_world, background, None, samples)
        hit = inverse > 0
        depth = np.where(hit, np.float32(1.0) / np.where(hit, inverse, np.float32(1.0)), np.float32(0.0))

        def mean(values: Array) -> Array:
            shape = (camera.height, samples, camera.width, samples, *values.shape[2:])
            return np.ascontiguousarray(values.reshape(shape).mean((1, 3), dtype=np.float32))

        return mean(image), mean(hit.astype(np.float32)), mean(depth)

    def coverage(self, camera: Camera, cam_from_world: Array, *, samples: int = SAMPLES) -> Array:
        """Share of each pixel's samples that meet a mesh, 0..1. [H, W].

        Args:
            camera: Camera of the picture.
            cam_from_world: Its pose. [4, 4].
            samples: Samples along each edge of a pixel.
        """
        _, inverse = self._samples(camera, cam_from_world, (0.0, 0.0, 0.0), None, samples)
        return (inverse > 0).reshape(camera.height, samples, camera.width, samples).mean((1, 3))

    def depth(self, camera: Camera, cam_from_world: Array) -> Array:
        """Camera z at every pixel centre, m; infinity where there is no mesh. [H, W] float32."""
        _, inverse = self._samples(camera, cam_from_world, (0.0, 0.0, 0.0), None, 1)
        with np.errstate(divide="ignore"):
            return np.float32(1.0) / inverse

    def _samples(
        self, camera: Camera, cam_from_world: Array, background: Sequence[float], light: Light | None, samples: int
    ) -> tuple[Array, Array]:
        """Colour and 1 / z of every sample."""
        if not camera.is_pinhole:
            raise ValueError("meshes are drawn by a camera without distortion")
        view = np.asarray(cam_from_world, np.float64)
        towards = np.zeros(3)
        if light is not None:
            towards = view[:3, :3] @ (np.asarray(light.direction) / np.linalg.norm(light.direction))
        size = (camera.height * samples, camera.width * samples)
        inverse = np.zeros(size, np.float32)
        image = np.empty((*size, 3), np.float32)
        image[:] = np.asarray(background, np.float32)
        pinhole = samples * np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        ambient = 1.0 if light is None else light.ambient
        _project(self._vertices, self._starts, view @ self._poses, pinhole, self._points, self._pixels)
        _draw(self._points, self._pixels, self._colours, self._faces, pinhole, towards, ambient, inverse, image)
        return image, inverse
