"""Physics-driven editing of Gaussians: the splats of a background and of moving bodies in one set of arrays.

A body at the pose (R, t) shows its splats at `R mean + t`, turned by `q_R * q` (Wu et al., RL-GSBridge, equation 3). The
covariance `R S S^T R^T` follows from the orientation; sizes and opacities stay. Plain RGB has no direction, so nothing of it
turns; spherical harmonics turn with the body (`gsbridge.splats.harmonics`).
"""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.geometry import Array
from gsbridge.splats.cloud import FIELDS, Cloud
from gsbridge.splats.harmonics import turned
from gsbridge.splats.rasterize.lanes import WIDTH

_RIGID = 1e-4
"""How far a pose's rotation may be from orthonormal."""


@njit(error_model="numpy")
def is_rigid(pose: Array) -> bool:
    """Whether a pose is finite and its 3 x 3 part is a rotation, within `_RIGID`. [4, 4] float64."""
    for i in range(3):
        for j in range(i + 1):
            dot = 0.0
            for k in range(3):
                dot += pose[k, i] * pose[k, j]
            # Written so that NaN fails it too.
            if not abs(dot - (i == j)) <= _RIGID:
                return False
        if not abs(pose[i, 3]) < np.inf:
            return False
    x, y, z = pose[:3, 0], pose[:3, 1], pose[:3, 2]
    # A reflection is orthonormal too.
    triple = x[0] * (y[1] * z[2] - y[2] * z[1]) + x[1] * (y[2] * z[0] - y[0] * z[2]) + x[2] * (y[0] * z[1] - y[1] * z[0])
    return triple > 0.0


@njit(error_model="numpy")
def _move(poses: Array, moved: Array, starts: Array, rest_means: Array, rest_quats: Array, means: Array, quats: Array) -> int:
    """Write the splats of all bodies marked as moved; return the first of them whose pose is not rigid, or -1.

    Args:
        poses: World from body. [B, 4, 4] float64.
        moved: [B] bool.
        starts: First splat of each body in `means`, and one past the last body's. [B + 1].
        rest_means, rest_quats: Splats in the body frames, from the first body on.
        means, quats: All splats; those of moved bodies are rewritten.
    """
    count = poses.shape[0]
    for body in range(count):
        if moved[body] and not is_rigid(poses[body]):
            return body
    for body in range(count):
        if not moved[body]:
            continue
        # float32 is enough: a world is a few metres large, so that rounding is below a micrometre.
        m = poses[body].astype(np.float32)
        r00, r01, r02, r10, r11, r12, r20, r21, r22 = (
            m[0, 0],
            m[0, 1],
            m[0, 2],
            m[1, 0],
            m[1, 1],
            m[1, 2],
            m[2, 0],
            m[2, 1],
            m[2, 2],
        )
        tx, ty, tz = m[0, 3], m[1, 3], m[2, 3]
        # Four ways to divide by a part of the quaternion; the largest part is safe (Shepperd, J. Guidance 1(3), 1978).
        one, half = np.float32(1.0), np.float32(0.5)
        trace = r00 + r11 + r22
        if trace > max(r00, r11, r22):
            w = np.sqrt(one + trace) * half
            s = half * half / w
            a, b, c, d = w, (r21 - r12) * s, (r02 - r20) * s, (r10 - r01) * s
        elif r00 >= r11 and r00 >= r22:
            w = np.sqrt(one + r00 - r11 - r22) * half
            s = half * half / w
            a, b, c, d = (r21 - r12) * s, w, (r01 + r10) * s, (r02 + r20) * s
        elif r11 >= r22:
            w = np.sqrt(one + r11 - r00 - r22) * half
            s = half * half / w
            a, b, c, d = (r02 - r20) * s, (r01 + r10) * s, w, (r12 + r21) * s
        else:
            w = np.sqrt(one + r22 - r00 - r11) * half
            s = half * half / w
            a, b, c, d = (r10 - r01) * s, (r02 + r20) * s, (r12 + r21) * s, w
        first = starts[0]
        for i in range(starts[body], starts[body + 1]):
            j = i - first
            px, py, pz = rest_means[j, 0], rest_means[j, 1], rest_means[j, 2]
            means[i, 0] = r00 * px + r01 * py + r02 * pz + tx
            means[i, 1] = r10 * px + r11 * py + r12 * pz + ty
            means[i, 2] = r20 * px + r21 * py + r22 * pz + tz
            qw, qx, qy, qz = rest_quats[j, 0], rest_quats[j, 1], rest_quats[j, 2], rest_quats[j, 3]
            quats[i, 0] = a * qw - b * qx - c * qy - d * qz
            quats[i, 1] = a * qx + b * qw + c * qz - d * qy
            quats[i, 2] = a * qy - b * qz + c * qw + d * qx
            quats[i, 3] = a * qz + b * qy - c * qx + d * qw
    return -1


@dataclass(frozen=True)
class Splats:
    """Arrays for one call of the rasteriser, world frame; the work space of a `Composition`, rewritten by its next pose.

    Args:
        means: Centres, m. [N, 3] float32.
        quats: Unit wxyz. [N, 4] float32.
        scales: Standard deviations along the splat's axes, m. [N, 3] float32.
        opacities: 0..1. [N] float32.
        colours: sRGB 0..1. [N, 3] float32.
        harmonics: How colours depend on the direction of view. [N, K, 3] float32.
    """

    means: Array
    quats: Array
    scales: Array
    opacities: Array
    colours: Array
    harmonics: Array

    def __len__(self) -> int:
        return len(self.means)

    def cloud(self) -> Cloud:
        """A copy that the next pose does not change."""
        return Cloud(*(getattr(self, name).copy() for name in FIELDS))


def require_clouds(clouds: Sequence[Cloud]) -> None:
    """Make sure that a composition gets clouds.

    Raises:
        TypeError: Something is no `Cloud`.
    """
    for cloud in clouds:
        if not isinstance(cloud, Cloud):
            raise TypeError(f"a composition takes clouds, no {type(cloud).__name__}: what it holds has to turn with its body")


class Composition:
    """Splats of a static background and of named bodies, packed once; only bodies that moved are written again.

    The arrays end in a few splats of no opacity, so that the rasteriser, which works on whole vectors, need not copy the arrays
    to fill them up. A body whose pose has not changed costs nothing.

    Args:
        bodies: Splats of each body, body frame. Bodies start at the world's origin.
        background: Splats of what never moves, world frame; None for nothing.

    Raises:
        TypeError: Something is no `Cloud`.
    """

    def __init__(self, bodies: Mapping[str, Cloud], background: Cloud | None = None) -> None:
        clouds = ([] if background is None else [background]) + list(bodies.values())
        require_clouds(clouds)
        self.names = tuple(bodies)
        self._index = {name: number for number, name in enumerate(self.names)}
        sizes = [len(cloud) for cloud in bodies.values()]
        static = 0 if background is None else len(background)
        self._starts = np.cumsum([static, *sizes]).astype(np.int64)
        self._count = int(self._starts[-1])
        room = -(-self._count // WIDTH) * WIDTH
        means, quats = np.zeros((room, 3), np.float32), np.zeros((room, 4), np.float32)
        scales, opacities, colours = (
            np.zeros((room, 3), np.float32),
            np.zeros(room, np.float32),
            np.zeros((room, 3), np.float32),
        )
        quats[:, 0] = 1.0
        terms = max((cloud.harmonics.shape[1] for cloud in clouds), default=0)
        self.splats = Splats(means, quats, scales, opacities, colours, np.zeros((room, terms, 3), np.float32))
        self._rest_means = np.empty((self._count - static, 3), np.float32)
        self._rest_quats = np.empty((self._count - static, 4), np.float32)
        self._rest_harmonics = np.zeros((self._count - static, terms, 3), np.float32)
        self._poses = np.tile(np.eye(4), (len(self.names), 1, 1))
        self._moved = np.zeros(len(self.names), np.bool_)
        if background is not None:
            self._write(slice(0, static), background)
        for name, cloud in bodies.items():
            self.reshape(name, cloud)

    def __len__(self) -> int:
        """Splats, without the filling at the end."""
        return self._count

    def part(self, name: str) -> slice:
        """Range of the arrays that holds the splats of a body.

        Raises:
            KeyError: There is no such body.
        """
        number = self._number(name)
        return slice(int(self._starts[number]), int(self._starts[number + 1]))

    def world_from_body(self, name: str) -> Array:
        """Pose that a body has now. [4, 4]."""
        return self._poses[self._number(name)].copy()

    def reshape(self, name: str, cloud: Cloud) -> None:
        """Give a body other splats of the same number (a deformed body); it stays at its pose.

        Args:
            name: Body.
            cloud: Splats, body frame.

        Raises:
            KeyError: There is no such body.
            ValueError: The number of splats differs, or their harmonics have a higher degree than any before.
        """
        part = self.part(name)
        if len(cloud) != part.stop - part.start:
            raise ValueError(f"{name} has {part.stop - part.start} splats; {len(cloud)} were given")
        if cloud.harmonics.shape[1] > self._rest_harmonics.shape[1]:
            raise ValueError(f"{name} came without harmonics of degree {cloud.sh_degree}; there is no room for them")
        static = int(self._starts[0])
        self._write(part, cloud)
        self._rest_harmonics[part.start - static : part.stop - static] = self.splats.harmonics[part]
        self._rest_means[part.start - static : part.stop - static] = cloud.means
        self._rest_quats[part.start - static : part.stop - static] = cloud.quats
        self._moved[self._number(name)] = True
        self._update()

    def pose(self, world_from_body: Mapping[str, Array]) -> Splats:
        """Move bodies; the others stay where they are.

        Args:
            world_from_body: Rigid poses by body. [4, 4] each.

        Returns:
            The arrays of the whole scene, rewritten in place.

        Raises:
            KeyError: There is no such body.
            ValueError: A pose is not rigid or not finite; nothing has moved then.
        """
        before = None
        for name, matrix in world_from_body.items():
            number = self._number(name)
            if not np.array_equal(self._poses[number], matrix):
                if before is None:
                    before = self._poses.copy()
                self._poses[number] = matrix
                self._moved[number] = True
        if before is not None:
            try:
                self._update()
            except ValueError:
                self._poses[:] = before
                raise
        return self.splats

    def _number(self, name: str) -> int:
        if name not in self._index:
            raise KeyError(f"there is no body {name!r}; there are {', '.join(self.names) or 'none'}")
        return self._index[name]

    def _write(self, part: slice, cloud: Cloud) -> None:
        for name in FIELDS[:-1]:
            getattr(self.splats, name)[part] = getattr(cloud, name)
        terms = cloud.harmonics.shape[1]
        self.splats.harmonics[part, :terms], self.splats.harmonics[part, terms:] = cloud.harmonics, 0.0

    def _update(self) -> None:
        """Write the splats of the bodies that moved."""
        splats = self.splats
        moved = np.flatnonzero(self._moved) if splats.harmonics.shape[1] else ()
        bad = _move(self._poses, self._moved, self._starts, self._rest_means, self._rest_quats, splats.means, splats.quats)
        self._moved[:] = False
        if bad >= 0:
            raise ValueError(f"the pose of {self.names[bad]} is no finite rigid transform:\n{self._poses[bad]}")
        for number in moved:
            first, last = int(self._starts[number]), int(self._starts[number + 1])
            rest = self._rest_harmonics[first - self._starts[0] : last - self._starts[0]]
            splats.harmonics[first:last] = turned(rest, self._poses[number, :3, :3])
