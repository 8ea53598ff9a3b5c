"""Photos of the mirror's wrist camera with planted faults of the camera or the light, for diagnoses against splats.

A world of the mirror, with all deviations of its severity, is photographed on a first day. On a later day it has one more
fault, in the formulations of `gsbridge.gap.benchmark.image_truth`, which bend rays, or remove or blur light before the sensor.
The camera's gains stay as the light of the first day sets them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from gsbridge.asset.bundle import read_asset
from gsbridge.cameras import Camera
from gsbridge.gap.benchmark.image_truth import FINE, TruthCamera
from gsbridge.gap.benchmark.image_world import ImageWorld
from gsbridge.geometry import Array
from gsbridge.images import to_u8
from gsbridge.reality.world.bodies import true_from_body
from gsbridge.reality.world.camera import Quality, Setting, expose, wrist_camera
from gsbridge.reality.world.electronics import Electronics
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table, true_robot
from gsbridge.reality.world.mirror import MirrorWorld, build_mirror
from gsbridge.tasks.views import ViewState, whole_pose

SIZES: Mapping[str, tuple[float, float, bool]] = {
    "exposure": (0.25, 0.8, True),
    "white_balance": (0.05, 0.15, False),
    "response": (0.1, 0.35, True),
    "black_level": (0.03, 0.1, True),
    "saturation": (0.25, 0.7, True),
    "vignetting": (0.4, 1.5, False),
    "distortion": (0.1, 0.3, True),
    "focal": (0.03, 0.1, True),
    "extrinsics": (0.008, 0.025, False),
    "defocus": (1.0, 3.0, False),
    "hue_cast": (0.3, 1.0, False),
    "shadow": (0.3, 0.8, False),
}
"""Faults that are planted: smallest and largest size, in the units of `TruthCamera`, and whether both signs are drawn. The
ranges were fixed before any trial, from what a person just sees in a photo to what a person calls broken."""

MARGIN = 0.15
"""Margin traced beyond the image's edges, as a share of its size, for lenses with a wider view."""

_RAYS = 2
"""Number of samples for each of the `FINE` x `FINE` parts of a pixel."""


@dataclass(frozen=True)
class PlantedFault:
    """A fault on the later day.

    Args:
        name: A name of `SIZES`; empty for no fault.
        size: Size of the fault, in the units of `TruthCamera`.
        spin: Direction, place and colour of the fault.
    """

    name: str
    size: float
    spin: Mapping[str, float]

    @classmethod
    def draw(cls, name: str, seed: int, middle: Sequence[float] = (0.0, 0.0)) -> PlantedFault:
        """Draw a fault.

        Args:
            name: A name of `SIZES`; empty for no fault.
            seed: Seed of its size, sign, direction, place and colour.
            middle: Point on the table at which the camera looks, m; a shadow falls near it. [2].
        """
        rng = np.random.default_rng([seed, sum(map(ord, name))])
        way, turn = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        colour, tint, angle = rng.dirichlet([0.7] * 3), rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
        spin = dict(zip(("x", "y", "z", "a", "b", "c", "r", "g", "bl"), (*way, *turn, *colour), strict=True))
        spin |= {"wr": np.cos(tint), "wb": np.sin(tint), "hx": rng.uniform(-0.5, 0.5), "hy": rng.uniform(-0.5, 0.5)}
        spin |= {"hr": rng.uniform(0.25, 0.45), "radius": rng.uniform(0.04, 0.09)}
        far = rng.uniform(0.0, 0.06)
        spin |= {"px": middle[0] + far * np.cos(angle), "py": middle[1] + far * np.sin(angle)}
        if not name:
            return cls("", 0.0, spin)
        low, high, both = SIZES[name]
        size = rng.uniform(low, high) * (rng.choice((-1.0, 1.0)) if both else 1.0)
        return cls(name, float(size), {key: float(value) for key, value in spin.items()})


@dataclass(frozen=True)
class MirrorStudio:
    """A world of the mirror in which chosen states are photographed.

    Args:
        world: The world.
        hidden: Hidden parameters of the world.
        size: Edge length of the photos, px.
        body_from_true: Transform from the frame of the true object to that of the reconstructed one. [4, 4].
    """

    world: MirrorWorld
    hidden: Hidden
    size: int
    body_from_true: Array

    @classmethod
    def build(cls, setting: Setting, hidden: Hidden, size: int, item: str | Path, pieces: str | Path) -> MirrorStudio:
        """Build the world.

        Args:
            setting: Object and background.
            hidden: Hidden parameters of the world.
            size: Edge length of the photos, px.
            item: `asset.json` of the reconstructed object, to which the object poses of states refer.
            pieces: Folder that caches convex pieces between runs.
        """
        body = np.eye(4)
        if setting.object is not None:
            body = np.linalg.inv(true_from_body(setting.object, setting.seed, read_asset(item).body_from_table))
        with TemporaryDirectory() as folder:
            robot, base = true_robot(Path(folder) / "robot", hidden), true_base_from_table(hidden)
            world = build_mirror(setting, robot, base, hidden, pieces=pieces, quality=Quality(_RAYS, 2))
        return cls(world, hidden, size, body)

    def photos(self, states: Sequence[ViewState], faults: Sequence[PlantedFault], first: int) -> Array:
        """Take photos of every state with each fault. [P, N, S, S, 3] uint8.

        Args:
            states: States of arm and object.
            faults: Faults, one at a time.
            first: Number of the first photo, which seeds the noise.
        """
        out = np.zeros((len(faults), len(states), self.size, self.size, 3), np.uint8)
        for n, state in enumerate(states):
            self.world.place(state.q, state.aperture, whole_pose(state.object_pose) @ self.body_from_true, first + n)
            self.world.camera.move(self.world.body_poses())
            pose = self.world.camera_pose()
            plain = self._traced(pose, first + n)
            for p, fault in enumerate(faults):
                out[p, n] = self._photo(fault, plain, pose, (first + n) * 64 + p)
        return out

    def _traced(self, pose: Array, number: int) -> Array:
        """Trace the linear light on a fine grid that is wider than the photo."""
        return self.world.camera.light(self._wide(), pose, Quality(_RAYS, 2), number)

    def _wide(self) -> Camera:
        camera, pad = wrist_camera(self.size), round(MARGIN * self.size)
        edge = self.size + 2 * pad
        return camera.cropped(-pad, -pad, edge, edge).scaled(FINE)

    def _photo(self, fault: PlantedFault, plain: Array, pose: Array, number: int) -> Array:
        """Take one photo with one fault. uint8 [S, S, 3]."""
        sizes = {fault.name: fault.size} if fault.name else {}
        camera, hidden = wrist_camera(self.size), self.hidden
        truth = TruthCamera(_NOTHING, camera, sizes, fault.spin)
        if fault.name == "extrinsics":
            pose = np.linalg.inv(truth.mount()) @ pose
            plain = self._traced(pose, number)
        focal = (1.0 + sizes.get("focal", 0.0)) * (1.0 + hidden.focal_error)
        rays = truth.rays(focal, hidden.distortion + sizes.get("distortion", 0.0), 0.0)
        wide = self._wide()
        # OpenCV puts the centre of the first pixel at zero.
        columns, rows = (
            (focus * rays[:, k] + middle - 0.5).reshape(FINE * self.size, -1).astype(np.float32)
            for k, focus, middle in ((0, wide.fx, wide.cx), (1, wide.fy, wide.cy))
        )

        def bent(light: Array) -> Array:
            """Return the light along `rays`, from light on the grid of `_traced`. [FINE * S, FINE * S, 3]."""
            fine = light.astype(np.float32)
            return np.asarray(cv2.remap(fine, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))

        light = bent(plain)
        usual = cv2.resize(light, (self.size, self.size), interpolation=cv2.INTER_AREA)
        if fault.name == "shadow":
            # The shadow falls on whatever a pixel shows, such as the gripper, which is nearer than the table behind it.
            light = bent(
                plain
                * truth.lamp(self.world.camera.seen_points(self._wide(), pose).reshape(-1, 3)).reshape(*plain.shape[:2], 1)
            )
        gathered = truth.gathered(light)
        electronics = Electronics(hidden, 0.05)
        # The gains follow the light without the fault, as on the first day.
        encoded = expose(gathered, hidden, np.random.default_rng([number, 2]), electronics.gains(usual)) / np.float32(255.0)
        return to_u8(truth.developed(encoded))


_NOTHING = ImageWorld.draw(0)
"""A world that `TruthCamera` asks for; nothing of it is seen here, since the mirror's light is used instead."""
