"""Rotations, similarities and planes.

Conventions of the whole library: `a_from_b` maps coordinates in frame b to frame a and is read right to left; quaternions
are wxyz (Hamilton); lengths are metres unless a name says otherwise; angles are radians unless a name ends in `_deg`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def quat_from_rotation(rotation: Array) -> Array:
    """Unit quaternions (wxyz, w >= 0) of rotation matrices. [..., 3, 3] -> [..., 4].

    Source: Bar-Itzhack, J. Guidance 23(6), 2000: the largest eigenvector of a symmetric 4x4 matrix, stable for every angle.
    """
    r = np.asarray(rotation, dtype=np.float64)
    xx, xy, xz = r[..., 0, 0], r[..., 0, 1], r[..., 0, 2]
    yx, yy, yz = r[..., 1, 0], r[..., 1, 1], r[..., 1, 2]
    zx, zy, zz = r[..., 2, 0], r[..., 2, 1], r[..., 2, 2]
    k = np.empty((*r.shape[:-2], 4, 4))
    k[..., 0, 0] = xx + yy + zz
    k[..., 1, 1] = xx - yy - zz
    k[..., 2, 2] = yy - xx - zz
    k[..., 3, 3] = zz - xx - yy
    k[..., 0, 1] = k[..., 1, 0] = zy - yz
    k[..., 0, 2] = k[..., 2, 0] = xz - zx
    k[..., 0, 3] = k[..., 3, 0] = yx - xy
    k[..., 1, 2] = k[..., 2, 1] = xy + yx
    k[..., 1, 3] = k[..., 3, 1] = xz + zx
    k[..., 2, 3] = k[..., 3, 2] = yz + zy
    quats = np.linalg.eigh(k)[1][..., :, -1]
    return np.where(quats[..., :1] < 0, -quats, quats)


def rotation_from_quat(quats: Array) -> Array:
    """Rotation matrices of quaternions (wxyz, any length). [..., 4] -> [..., 3, 3]."""
    q = np.asarray(quats, dtype=np.float64)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    # Written entry by entry: tasks call this every step, for one quaternion, where stacking costs more than computing.
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return out


def quat_multiply(left: Array, right: Array) -> Array:
    """Hamilton product (wxyz): the rotation `right` followed by `left`. [..., 4]."""
    lw, lx, ly, lz = np.moveaxis(np.asarray(left), -1, 0)
    rw, rx, ry, rz = np.moveaxis(np.asarray(right), -1, 0)
    return np.stack(
        [
            lw * rw - lx * rx - ly * ry - lz * rz,
            lw * rx + lx * rw + ly * rz - lz * ry,
            lw * ry - lx * rz + ly * rw + lz * rx,
            lw * rz + lx * ry - ly * rx + lz * rw,
        ],
        axis=-1,
    )


def rotation_angle(rotation: Array) -> Array:
    """Angle of rotation matrices, rad in 0..pi. [..., 3, 3] -> [...]."""
    r = np.asarray(rotation)
    skew = np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], axis=-1)
    # atan2 keeps small angles, which acos of the trace loses.
    return np.arctan2(np.linalg.norm(skew, axis=-1), np.trace(r, axis1=-2, axis2=-1) - 1.0)


def rotation_between(source: Array, target: Array) -> Array:
    """Shortest rotation that turns the direction `source` into `target`. [3], [3] -> [3, 3]."""
    a = np.asarray(source, dtype=np.float64) / np.linalg.norm(source)
    b = np.asarray(target, dtype=np.float64) / np.linalg.norm(target)
    axis = np.cross(a, b)
    cosine = float(a @ b)
    if cosine < -1.0 + 1e-12:
        # Opposite directions: any axis perpendicular to `a` does; the axis of its smallest component is far from parallel.
        helper = np.eye(3)[np.argmin(np.abs(a))]
        across = np.cross(a, helper)
        across /= np.linalg.norm(across)
        return 2.0 * np.outer(across, across) - np.eye(3)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + k + k @ k / (1.0 + cosine)


@dataclass(frozen=True)
class Similarity:
    """`target = scale * rotation @ source + translation`."""

    scale: float
    rotation: Array
    translation: Array

    def apply(self, points: Array) -> Array:
        """Map points. [..., 3] -> [..., 3]."""
        return self.scale * np.asarray(points) @ self.rotation.T + self.translation

    def inverse(self) -> Similarity:
        """The similarity that undoes this one."""
        return Similarity(1.0 / self.scale, self.rotation.T, -self.rotation.T @ self.translation / self.scale)

    def compose(self, first: Similarity) -> Similarity:
        """The similarity that applies `first`, then this one."""
        return Similarity(self.scale * first.scale, self.rotation @ first.rotation, self.apply(first.translation))

    def matrix(self) -> Array:
        """4x4 matrix whose upper left block is `scale * rotation`."""
        out = np.eye(4)
        out[:3, :3] = self.scale * self.rotation
        out[:3, 3] = self.translation
        return out

    @classmethod
    def from_matrix(cls, matrix: Array) -> Similarity:
        """Read a similarity's matrix. [4, 4].

        Raises:
            ValueError: The upper left block is no positive multiple of a rotation.
        """
        block = np.asarray(matrix, dtype=np.float64)[:3, :3]
        scale = float(np.cbrt(np.linalg.det(block)))
        if scale <= 0 or not np.allclose(block.T @ block, scale**2 * np.eye(3), atol=1e-6 * max(scale**2, 1e-12)):
            raise ValueError("the matrix is no similarity: its upper left block is no positive multiple of a rotation")
        return cls(scale, block / scale, np.asarray(matrix, dtype=np.float64)[:3, 3].copy())

    def move_pose(self, cam_from_source: Array) -> Array:
        """Rigid pose of a camera in the target frame: `cam_from_target`, from `cam_from_source`. [..., 4, 4]."""
        pose = np.asarray(cam_from_source, dtype=np.float64)
        rotation = pose[..., :3, :3] @ self.rotation.T
        out = np.zeros_like(pose)
        out[..., 3, 3] = 1.0
        out[..., :3, :3] = rotation
        out[..., :3, 3] = self.scale * pose[..., :3, 3] - rotation @ self.translation
        return out


def align_similarity(source: Array, target: Array, *, with_scale: bool = True) -> Similarity:
    """Best similarity from paired points, in the least-squares sense.

    Args:
        source: Points in the source frame. [N, 3].
        target: Coordinates of those points in the target frame. [N, 3].
        with_scale: Estimate the scale too; otherwise it stays 1.

    Returns:
        `target_from_source`.

    Raises:
        ValueError: Fewer than three pairs, or all on one line.

    Source: Umeyama, IEEE PAMI 13(4), 1991.
    """
    a = np.asarray(source, dtype=np.float64)
    b = np.asarray(target, dtype=np.float64)
    if len(a) < 3 or a.shape != b.shape:
        raise ValueError("a similarity needs at least three point pairs")
    mean_a, mean_b = a.mean(0), b.mean(0)
    u, singular, vt = np.linalg.svd((b - mean_b).T @ (a - mean_a) / len(a))
    if singular[1] <= 1e-12 * max(singular[0], 1e-300):
        raise ValueError("the points lie on one line: the rotation about it is not determined")
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ np.diag(sign) @ vt
    variance = ((a - mean_a) ** 2).sum() / len(a)
    scale = float((singular * sign).sum() / variance) if with_scale else 1.0
    return Similarity(scale, rotation, mean_b - scale * rotation @ mean_a)


def fit_plane(points: Array) -> tuple[Array, float]:
    """Least-squares plane `normal . x = offset` through points. [N, 3] -> unit normal [3], offset.

    Raises:
        ValueError: Fewer than three points.
    """
    p = np.asarray(points, dtype=np.float64)
    if len(p) < 3:
        raise ValueError("a plane needs at least three points")
    centre = p.mean(0)
    normal = np.linalg.svd(p - centre, full_matrices=False)[2][-1]
    return normal, float(normal @ centre)
