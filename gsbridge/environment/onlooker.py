"""Pictures of trials from beside the table: arm, object and table as splats, posed as a trial's log says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from gsbridge.asset.bundle import read_asset
from gsbridge.cameras import Camera, look_at
from gsbridge.environment.build import StageFiles
from gsbridge.environment.gaussian_renderer import OBJECT, GaussianRenderer
from gsbridge.environment.light import LightFile
from gsbridge.environment.robot_splats import mean_cloud_colour, read_robot_splats
from gsbridge.environment.trial_log import TrialPath
from gsbridge.errors import InputError
from gsbridge.geometry import Array, rotation_from_quat
from gsbridge.registration.result import read_registration
from gsbridge.robot.assembly import RobotFiles
from gsbridge.robot.kinematics import Kinematics
from gsbridge.robot.nominal import base_from_table as nominal_table
from gsbridge.robot.reach import tool_down
from gsbridge.scene.shading import TABLE_HEIGHT
from gsbridge.scene.shadows import Shadows
from gsbridge.scene.view import Shot

EYE, TARGET = (1.15, -1.2, 0.85), (-0.23, 0.0, 0.36)
"""Where the onlooker stands and looks at, table frame, m: on the far side of the table from the arm, a step to its left."""

FOCAL_SHARE = 1.05
"""Focal length in widths of the picture: a view of some 50 degrees, as of a phone's main camera turned sideways."""

PAPER, STAND, STAND_SIDE, STAND_TOP = (0.93, 0.94, 0.95), (0.76, 0.77, 0.78), (0.68, 0.69, 0.70), (0.83, 0.84, 0.85)
"""Colours of what was not filmed, sRGB: the room, and the visible faces of the stand below the arm."""

STAND_EDGE, REACH = 0.24, 1.1
"""Edge of the stand, and radius of the plain ground round the table's origin, m."""


@dataclass
class OnlookerView:
    """An onlooker's camera.

    Args:
        robot: The robot's description, and the numbers of its gripper.
        base_from_table: Registered place of the table. [4, 4].
        renderer: Splats of object, table and links, and the camera; without shadows.
        shadows: Shadows of arm and object on the table; None to draw none.
        tone: Colour of the ground beyond the filmed part of the table, sRGB 0..1. [3].
    """

    robot: RobotFiles
    base_from_table: Array
    renderer: GaussianRenderer
    shadows: Shadows | None
    tone: Array

    def __post_init__(self) -> None:
        self.kinematics = Kinematics.read(self.robot.urdf)
        self.cam_from_table = look_at(np.array(EYE), np.array(TARGET))
        self.table_from_base = np.linalg.inv(self.base_from_table)
        self.beyond = self._beyond() - 255.0 * np.array(PAPER)

    @classmethod
    def build(cls, files: StageFiles, width: int, height: int) -> OnlookerView:
        """Read the splats.

        Args:
            files: Files that the simulated environment is made of; the links' splats are needed.
            width, height: Size of the pictures, px.

        Raises:
            InputError: A file is missing or damaged.
        """
        if files.robot_splats is None:
            raise InputError("robot splats", "the onlooker sees the robot as splats", "Give their folder")
        item, table = read_asset(files.item), read_asset(files.background)
        camera = Camera(width, height, FOCAL_SHARE * width, FOCAL_SHARE * width, width / 2, height / 2)
        shadows = None if files.light is None else LightFile.read(files.light).shadows(OBJECT, item)
        links, cloud = read_robot_splats(files.robot_splats), table.cloud()
        renderer = GaussianRenderer(item.cloud(), cloud, links, camera, surface=table.mesh(), backdrop=PAPER, oversampling=1)
        registered = nominal_table() if files.registration is None else read_registration(files.registration).base_from_table
        return cls(RobotFiles.read(files.robot), registered, renderer, shadows, mean_cloud_colour(cloud))

    def pictures(self, path: TrialPath, every: int = 1) -> list[Array]:
        """Pictures of a trial, its last state included. uint8 [H, W, 3] each.

        The log holds the tool's pose and the opening. Inverse kinematics gives the arm's joints, starting from the solution of
        the state before. The hand is therefore where it was in the trial, but the elbow may differ a little.

        Args:
            path: The trial.
            every: Draw one picture per this many states.
        """
        joints: Array | None = None
        out = []
        for state in [*range(0, len(path) - 1, every), len(path) - 1]:
            pose = self.base_from_table @ tool_down(path.tool[state], path.tool_yaw[state])
            if np.isfinite(pose).all():
                joints = self.kinematics.inverse(pose, joints).q
            if joints is None:
                raise InputError("trial", "its first pose is not finite", "Try the policy again")
            driver = float(self.robot.dimensions.angle(path.aperture[state]))
            placed = self.kinematics.poses(np.append(joints, driver))
            poses = dict(zip(self.kinematics.tree.links, self.table_from_base @ placed, strict=True))
            poses[OBJECT] = np.eye(4)
            poses[OBJECT][:3, :3] = rotation_from_quat(path.object_quat[state])
            poses[OBJECT][:3, 3] = path.object_position[state]
            shot = self.renderer.shot(poses, self.cam_from_table)
            seen = self._shaded(shot, poses) + (1.0 - shot.alphas[..., None]) * self.beyond
            out.append(np.clip(np.rint(seen), 0, 255).astype(np.uint8))
        return out

    def _shaded(self, shot: Shot, poses: Mapping[str, Array]) -> Array:
        """Return the picture with shadows on the table only, since they are modelled for level surfaces. 0..255 [H, W, 3]."""
        if self.shadows is None:
            return shot.pixels
        camera = self.renderer.camera
        dim = (shot.pixels / 255.0).astype(np.float32)
        self.shadows.dim(dim, shot.depths * shot.alphas, shot.alphas, camera, self.cam_from_table, poses)
        table_from_cam = np.linalg.inv(self.cam_from_table)
        heights = shot.depths * (camera.pixel_rays() @ table_from_cam[2, :3]) + table_from_cam[2, 3]
        return np.where((heights < TABLE_HEIGHT)[..., None], 255.0 * dim, shot.pixels)

    def _beyond(self) -> Array:
        """Draw plainly what was not filmed: level ground, and a stand below the arm. 0..255 [H, W, 3]."""
        camera = self.renderer.camera
        out = np.empty((camera.height, camera.width, 3), np.float32)
        out[:] = 255.0 * np.array(PAPER)
        turns = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
        ground = REACH * np.c_[np.cos(turns), np.sin(turns), 0.0 * turns]
        faces: list[tuple[Array, ArrayLike]] = [(ground, 0.55 * np.array(PAPER) + 0.45 * self.tone)]
        # The stand's four corners along the axes of the arm's base: front right, front left, back left, back right.
        half, foot = STAND_EDGE / 2, self.table_from_base[2, 3]
        corners = np.array([[half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0], [-half, -half, 0.0]])
        top = corners @ self.table_from_base[:3, :3].T + self.table_from_base[:3, 3]
        if foot > 0.0:
            below = top * (1.0, 1.0, 0.0)
            front, side = [top[0], top[1], below[1], below[0]], [top[3], top[0], below[0], below[3]]
            faces += [(np.array(side), STAND_SIDE), (np.array(front), STAND), (top, STAND_TOP)]
        for points, colour in faces:
            pixels = camera.project(points @ self.cam_from_table[:3, :3].T + self.cam_from_table[:3, 3])
            fixed = np.rint(16.0 * pixels).astype(np.int32)
            cv2.fillConvexPoly(out, fixed, [float(channel) for channel in 255.0 * np.asarray(colour)], cv2.LINE_AA, 4)
        return out
