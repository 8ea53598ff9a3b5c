"""Arms for the tests of the runner: the hand without physics behind a driver, and clocks that tests set."""

import numpy as np
import torch
from environment_fixture import HandWorld

from gsbridge.configuration.policy import PolicySettings
from gsbridge.environment.env import PickEnvironment
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.files import write_json
from gsbridge.policy.driver import Reading
from gsbridge.policy.export import describe, save_policy
from gsbridge.policy.interface import PolicyInterface
from gsbridge.policy.networks import Actor
from gsbridge.policy.runner import Setup
from gsbridge.policy.safety import Limits
from gsbridge.policy.worlds import WorldClock
from gsbridge.registration.result import Registration
from gsbridge.robot import nominal
from gsbridge.robot.reach import tool_down

POSE, SEED = np.array([0.03, 0.24, 0.2]), 5


def base_from_table():
    """The nominal place, turned and tilted a little, so that no frame can be left out unnoticed."""
    out = nominal.base_from_table()
    turn, tilt = 0.3, 0.02
    about = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    lean = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    out[:3, :3] = lean @ about
    return out


class SteadyHand(HandWorld):
    """`HandWorld` with a picture that a last bit of its place does not change: whole millimetres lie between two levels."""

    def image(self, size):
        ramp = np.add.outer(np.arange(size), 2 * np.arange(size))[..., None] + 1000 * np.array([*self.tool[:2], self.cube[2]])
        return ((ramp + self.rng.integers(0, 4, 3) + 0.371) % 256).astype(np.uint8)


class HandDriver:
    """`SteadyHand` as an arm; remembers what was asked of it."""

    def __init__(self, lag=1, size=64):
        self.world, self.camera = SteadyHand(lag), wrist_camera(size)
        self.base_from_table, self.table_from_base = base_from_table(), np.linalg.inv(base_from_table())
        self.calls, self.commands, self.answer = [], [], None

    def rest(self):
        self.calls.append("rest")
        self.world.reset(POSE, SEED)

    def measure(self):
        return Reading(self.base_from_table @ tool_down(self.world.tool, self.world.yaw), self.world.aperture)

    def image(self):
        return self.world.image(self.camera.width)

    def command(self, base_from_tool, aperture):
        self.calls.append("command")
        self.commands.append((np.array(base_from_tool), aperture))
        pose = self.table_from_base @ base_from_tool
        self.world.command(pose[:3, 3], np.arctan2(pose[1, 0], pose[0, 0]), aperture)
        return self.answer

    def stop(self):
        self.calls.append("stop")


class SlowClock:
    """A clock on which computing takes time: whoever computes adds it to `time`."""

    def __init__(self, world):
        self.world, self.time = world, 0.0

    def now(self):
        return self.time

    def wait_until(self, moment):
        assert moment >= self.time
        self.world.step()
        self.time = moment


def spec(**settings):
    """`policy.json` of an environment on the hand."""
    from gsbridge.files import _plain

    chosen = EnvironmentSettings(**{"image_size": 64, **settings})
    content = describe(PickEnvironment(HandWorld(1, chosen.plate), chosen), PolicySettings(image_size=chosen.image_size))
    return _plain(content)


def interface(**settings):
    return PolicyInterface.of(spec(**settings))


def registration(**values):
    return Registration(base_from_table(), nominal.flange_from_camera(), **values)


def setup(driver=None, clock=None, limits=None, **settings):
    """A setup on the hand, with its own clock."""
    driver = driver or HandDriver()
    return Setup(interface(**settings), driver, registration(), clock or WorldClock(driver.world, 0.05), limits or Limits())


def write_policy(folder, seed=0, **settings):
    """An untrained policy; its weights are large, so that its actions are."""
    torch.manual_seed(seed)
    actor = Actor()
    with torch.no_grad():
        for value in actor.parameters():
            value.mul_(2.0)
    save_policy(folder, actor.state_dict(), spec(**settings))
    return folder


def write_registration(path):
    write_json(
        path,
        {
            "base_from_table": base_from_table(),
            "flange_from_camera": nominal.flange_from_camera(),
            "reasons": [],
            "camera": wrist_camera(64).to_json(),
        },
    )
    return path
