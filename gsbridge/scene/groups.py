"""A composition for one camera and many pictures: splats stay in the frames of their bodies, and only what is in view is drawn.

It shows what `gsbridge.scene.editing.Composition` shows (Wu et al., RL-GSBridge, equation 3), but a body's pose becomes part of
the camera's view of that body. So no splat is written again, and spherical harmonics are evaluated for the camera's position in
the body's frame. Splats are kept in groups of neighbours. Groups outside the view are skipped, which changes nothing but the
order of equal depths; the wrist camera has less than half of a scene in view.
"""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.scene.editing import is_rigid, require_clouds
from gsbridge.splats.cloud import FIELDS, Cloud, concatenate
from gsbridge.splats.rasterize.cpu import Prepared, Seen
from gsbridge.splats.rasterize.layout import GROUP, NEAR

REACH = 3.4
"""Standard deviations at which an opaque splat falls below the rasteriser's cut of 1/255 (3.33)."""

SLOPE = 1.3
"""Factor by which the rasteriser may draw a splat near the picture's edge wider than its bounding ball projects: the rasteriser
linearises the projection at the splat's centre, which may lie up to `layout.MARGIN` of the picture beyond the edge."""

EDGE_PX = 3.0
"""Margin round the picture for the rasteriser's blur of thin splats, px: `REACH` times the blur's deviation of 0.55 px, and a
pixel."""


_NOTHING = Cloud(*(np.zeros((0, *tail)) for tail in ((3,), (4,), (3,), (), (3,))))


@dataclass(frozen=True)
class _Bounds:
    """Bounding balls of the groups of one cloud.

    Args:
        balls: Centre and radius of the means, m. [G, 4].
        reaches: How far the largest splat reaches beyond its mean, m. [G].
    """

    balls: Array
    reaches: Array


def _parts(features: Array) -> list[Array]:
    """Split points into groups of `GROUP` neighbours; only the last group may be smaller. [N, D] -> indices, [GROUP] each."""
    waiting, done = [np.arange(len(features))], []
    while waiting:
        part = waiting.pop()
        if len(part) <= GROUP:
            done.append(part)
            continue
        values = features[part]
        ordered = part[np.argsort(values[:, np.ptp(values, axis=0).argmax()], kind="stable")]
        half = GROUP * max(1, round(len(part) / 2 / GROUP))
        # The first half makes whole groups, so that only the very last group may have room left.
        waiting += [ordered[half:], ordered[:half]]
    return sorted(done, key=len, reverse=True)


def _grouped(cloud: Cloud) -> tuple[Cloud, _Bounds]:
    """A cloud in the order of its groups, the last of which is filled up with splats of no opacity, and the groups' bounds."""
    means = np.asarray(cloud.means, dtype=np.float64)
    reaches = REACH * np.asarray(cloud.scales, dtype=np.float64).max(1, initial=0.0)
    # The reach is a coordinate as well, so that large splats form groups of their own: one large splat widens its whole group.
    parts = _parts(np.concatenate([means, reaches[:, None]], axis=1)) if len(means) else []
    bounds = _Bounds(np.zeros((len(parts), 4)), np.zeros(len(parts)))
    for number, part in enumerate(parts):
        centre = 0.5 * (means[part].min(0) + means[part].max(0))
        bounds.balls[number] = *centre, np.linalg.norm(means[part] - centre, axis=1).max()
        bounds.reaches[number] = reaches[part].max()
    order = np.concatenate([np.zeros(0, np.int64), *parts])
    filling = -len(order) % GROUP
    ordered = cloud.subset(order)
    if filling == 0:
        return ordered, bounds
    nothing = Cloud(
        np.zeros((filling, 3)),
        np.tile([1.0, 0.0, 0.0, 0.0], (filling, 1)),
        np.full((filling, 3), 1e-6),
        np.zeros(filling),
        np.zeros((filling, 3)),
    )
    return concatenate([ordered, nothing]), bounds


@njit(error_model="numpy")
def _see(
    poses: Array,
    cam_from_world: Array,
    owners: Array,
    balls: Array,
    reaches: Array,
    lens: tuple[float, ...],
    size: tuple[int, int],
) -> tuple[int, Array, Array, Array]:
    """Find the groups that a picture may show.

    Args:
        poses: World from body. [B, 4, 4].
        cam_from_world: [4, 4].
        owners: Body of each group. [G].
        balls, reaches: As in `_Bounds`, of all groups.
        lens: fx, fy, cx, cy.
        size: Width and height, px.

    Returns:
        Number of groups found, or -1 - b where the pose of body b is not rigid; then groups, owners and views as in
        `gsbridge.splats.rasterize.cpu.Seen`, with room for all groups.
    """
    views = np.empty((poses.shape[0], 16), np.float32)
    groups, seen_owners = np.empty(owners.shape[0], np.int64), np.empty(owners.shape[0], np.int64)
    for body in range(poses.shape[0]):
        if not is_rigid(poses[body]):
            return -1 - body, groups, seen_owners, views
        for i in range(4):
            views[body, i] = lens[i]
        for i in range(3):
            for j in range(4):
                value = cam_from_world[i, 3] if j == 3 else 0.0
                for k in range(3):
                    value += cam_from_world[i, k] * poses[body, k, j]
                views[body, 13 + i if j == 3 else 4 + 3 * i + j] = value
    fx, fy = lens[0], lens[1]
    left, right = -EDGE_PX - lens[2], size[0] + EDGE_PX - lens[2]
    top, bottom = -EDGE_PX - lens[3], size[1] + EDGE_PX - lens[3]
    # Lengths of the normals of the planes through the camera and the picture's edges.
    n_left, n_right = math.sqrt(fx * fx + left * left), math.sqrt(fx * fx + right * right)
    n_top, n_bottom = math.sqrt(fy * fy + top * top), math.sqrt(fy * fy + bottom * bottom)
    count = 0
    for group in range(owners.shape[0]):
        v = views[owners[group]]
        a, b, c, radius = balls[group, 0], balls[group, 1], balls[group, 2], balls[group, 3]
        x = v[4] * a + v[5] * b + v[6] * c + v[13]
        y = v[7] * a + v[8] * b + v[9] * c + v[14]
        z = v[10] * a + v[11] * b + v[12] * c + v[15]
        room = SLOPE * (radius + reaches[group])
        if z + room < NEAR or fx * x - right * z > room * n_right or left * z - fx * x > room * n_left:
            continue
        if fy * y - bottom * z > room * n_bottom or top * z - fy * y > room * n_top:
            continue
        groups[count], seen_owners[count] = group, owners[group]
        count += 1
    return count, groups, seen_owners, views


class GroupedComposition:
    """Splats of a static background and of named bodies, kept in groups of neighbours.

    Args:
        bodies: Splats of each body, body frame.
        background: Splats of what never moves, world frame; None for nothing.

    Raises:
        TypeError: Something is no `Cloud`.
    """

    def __init__(self, bodies: Mapping[str, Cloud], background: Cloud | None = None) -> None:
        self.names = tuple(bodies)
        clouds = [*bodies.values(), *([] if background is None else [background])]
        require_clouds(clouds)
        made = [_grouped(cloud) for cloud in clouds]
        joined = concatenate([cloud for cloud, _ in made]) if made else _NOTHING
        self._shown = sum(map(len, clouds))
        # The background counts as one more body after all others, whose pose stays the identity.
        self._owners = np.concatenate([np.zeros(0, np.int64), *(np.full(len(b.balls), k) for k, (_, b) in enumerate(made))])
        self._bounds = tuple(
            np.concatenate([np.zeros((0, *tail)), *(getattr(item, name) for _, item in made)])
            for name, tail in (("balls", (4,)), ("reaches", ()))
        )
        self._poses = np.tile(np.eye(4), (len(self.names) + 1, 1, 1))
        self._flat = self._poses[:-1].reshape(-1, 4)
        self.splats = Prepared.of(*(getattr(joined, name) for name in FIELDS))

    def __len__(self) -> int:
        """Splats, without the filling."""
        return self._shown

    def see(self, world_from_body: Mapping[str, Array], camera: Camera, cam_from_world: Array) -> Seen:
        """Groups of the bodies' splats that a camera sees at some poses.

        Args:
            world_from_body: Rigid poses of all bodies. [4, 4] each.
            camera: Pinhole.
            cam_from_world: Pose, OpenCV axes. [4, 4].

        Raises:
            KeyError: A body has no pose.
            ValueError: A pose is not rigid or not finite.
        """
        if self.names:
            np.concatenate([world_from_body[name] for name in self.names], out=self._flat)
        lens, size = camera.pinhole_numbers, (camera.width, camera.height)
        pose = np.ascontiguousarray(cam_from_world, dtype=np.float64)
        seen, groups, owners, views = _see(self._poses, pose, self._owners, self._bounds[0], self._bounds[1], lens, size)
        if seen < 0:
            number = -1 - seen
            raise ValueError(f"the pose of {self.names[number]} is no finite rigid transform:\n{self._poses[number]}")
        return Seen(groups[:seen], owners[:seen], views)
