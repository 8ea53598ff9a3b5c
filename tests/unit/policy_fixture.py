"""A world to learn in: the hand and the cube of the environment's tests, seen as blobs by a camera on the hand."""

import numpy as np
from environment_fixture import GRIP, HandWorld

from gsbridge.environment.controllers import GraspController
from gsbridge.environment.env import PickEnvironment
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.policy.observation import ObservedFrame, Observer

HALF = 0.029
CONTROLLER = GraspController(GRIP)


class BlobWorld(HandWorld):
    """`HandWorld` whose camera looks down along the tool: a red square for the cube, grey bars for the pads."""

    def image(self, size):
        across = (np.arange(size) + 0.5) / size - 0.5
        picture = np.full((size, size, 3), (90, 80, 70), np.uint8)
        # The angle of view is wide enough for the whole start region from the rest posture.
        depth = self.tool[2] + 0.1 - self.cube[2] - 2 * HALF
        plane = 1.25 * depth * across
        offset = self.cube[:2] - self.tool[:2]
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        x = plane[:, None] - (cosine * offset[0] + sine * offset[1])
        y = plane[None, :] - (cosine * offset[1] - sine * offset[0])
        turn = self.cube_yaw - self.yaw
        along, aside = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
        picture[(np.abs(along) < HALF) & (np.abs(aside) < HALF)] = (190, 40, 30)
        near = 0.125 * across
        pads = (np.abs(near)[:, None] < 0.01) & (np.abs(np.abs(near) - 0.4 * self.aperture)[None, :] < 0.006)
        picture[pads] = (40, 40, 45)
        return picture


def blob_environment(**settings) -> PickEnvironment:
    """An environment on it."""
    chosen = EnvironmentSettings(**{"image_size": 64, "hold_steps": 3, "max_steps": 60, **settings})
    return PickEnvironment(BlobWorld(1, chosen.plate), chosen)


def blob_observer(environment: PickEnvironment) -> Observer:
    return Observer(ObservedFrame.of(environment), CONTROLLER)
