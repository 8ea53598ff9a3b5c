"""Trials seen from beside the table: arm, object and table as splats, placed anew from what a trial's log tells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.asset.bundle import read_asset
from gsbridge.cameras import Camera, look_at
from gsbridge.environment.build import StageFiles
from gsbridge.environment.gaussian_renderer import OBJECT, GaussianRenderer
from gsbridge.environment.light import LightFile
from gsbridge.environment.robot_splats import read_robot_splats
from gsbridge.environment.trial_log import TrialPath
from gsbridge.errors import InputError
from gsbridge.geometry import Array, rotation_from_quat
from gsbridge.registration.result import read_registration
from gsbridge.robot.assembly import RobotFiles
from gsbridge.robot.kinematics import Kinematics
from gsbridge.robot.nominal import base_from_table as nominal_table
from gsbridge.robot.reach import tool_down

EYE, TARGET = (0.95, -1.05, 0.8), (-0.22, 0.0, 0.26)
"""Where the onlooker stands and looks, table frame, m: on the far side of the table from the arm, a step to its left."""

FOCAL_SHARE = 1.05
"""Focal length in widths of the picture: a view of some 50 degrees, as of a phone's main camera turned sideways."""

PAPER = (0.93, 0.94, 0.95)
"""Colour where nothing was filmed, sRGB: around the table there are no splats."""


@dataclass
class OutsideView:
    """An onlooker's camera.

    Args:
        robot: The robot's description, and the numbers of its gripper.
        base_from_table: Registered place of the table. [4, 4].
        renderer: Splats of object, table and links, and the camera.
    """

    robot: RobotFiles
    base_from_table: Array
    renderer: GaussianRenderer

    def __post_init__(self) -> None:
        self.kinematics = Kinematics.read(self.robot.urdf)
        self.cam_from_table = look_at(np.array(EYE), np.array(TARGET))
        self.table_from_base = np.linalg.inv(self.base_from_table)

    @classmethod
    def build(cls, files: StageFiles, width: int, height: int) -> OutsideView:
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
        links = read_robot_splats(files.robot_splats)
        renderer = GaussianRenderer(
            item.cloud(), table.cloud(), links, camera, surface=table.mesh(), backdrop=PAPER, shadows=shadows
        )
        registered = nominal_table() if files.registration is None else read_registration(files.registration).base_from_table
        return cls(RobotFiles.read(files.robot), registered, renderer)

    def pictures(self, path: TrialPath, every: int = 1) -> list[Array]:
        """Pictures of a trial, its last state included. uint8 [H, W, 3] each.

        The log holds the tool's pose and the opening. Arm joints follow from them by inverse kinematics, each from those before
        it, so that the elbow may stand a little otherwise than it did; the hand stands where it stood.

        Args:
            path: The trial.
            every: States per picture.
        """
        joints: Array | None = None
        out = []
        states = [*range(0, len(path) - 1, every), len(path) - 1]
        for state in states:
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
            out.append(self.renderer.render(poses, self.cam_from_table))
        return out
