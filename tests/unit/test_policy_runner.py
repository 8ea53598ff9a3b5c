"""The control loop: the very trajectory of the environment, guards, pace, and an arm that is always stopped."""

import signal

import numpy as np
import pytest
from driver_fixture import POSE, SEED, HandDriver, SlowClock, SteadyHand, base_from_table, interface, registration, setup, spec
from environment_fixture import hand_environment
from robot_fixture import robot

from gsbridge.cameras import Camera
from gsbridge.environment.env import PickEnvironment
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.errors import InputError
from gsbridge.policy.driver import JointArm, Reading, tool_pose
from gsbridge.policy.episode_log import EpisodeLog
from gsbridge.policy.interface import PolicyInterface
from gsbridge.policy.runner import Setup, run_policy
from gsbridge.policy.safety import End, Limits
from gsbridge.policy.worlds import WorldClock
from gsbridge.registration.result import Registration
from gsbridge.robot import nominal


class Scripted:
    """Acts by what it sees, in thousandths so that a last bit of `proprio` makes no difference; remembers what it saw."""

    def __init__(self):
        self.seen = []

    def __call__(self, observation, info):
        self.seen.append({name: np.array(value) for name, value in observation.items()})
        where = observation["image"][10:20, 30:40].astype(np.int64).sum() % 997 / 997 - 0.5
        wanted = np.array([0.9 * where, -where, -0.4, 0.3, -0.2]) + 0.3 * observation["proprio"][[2, 0, 1, 5, 9]]
        return np.round(wanted, 3)


def nothing(observation, info):
    return np.zeros(5)


def test_the_same_trajectory_as_in_the_environment():
    env, there, here = PickEnvironment(SteadyHand(2), EnvironmentSettings(image_size=64)), Scripted(), Scripted()
    # The environment draws the episode's seed, the driver is given one.
    reset = env.world.reset
    env.world.reset = lambda pose, seed: reset(pose, SEED)
    observation, _ = env.reset(seed=1, options={"pose": POSE})
    tools, commands = [], []
    for _ in range(80):
        tools.append([*env.world.tool, env.world.yaw, env.world.aperture])
        observation, *_, info = env.step(there(observation, {}))
        commands.append([*info["target"]["position"], info["target"]["yaw"], info["target"]["aperture"]])
    log = run_policy(here, setup(HandDriver(lag=2)))
    assert log.end == End.TIME_OUT
    assert log.steps == 80
    # The runner's policy warms up once.
    for a, b in zip(there.seen, here.seen[1:], strict=True):
        np.testing.assert_array_equal(a["image"], b["image"])
        np.testing.assert_allclose(a["proprio"], b["proprio"], atol=1e-9, rtol=2e-7)
    rows = np.array(log.rows)
    np.testing.assert_allclose(rows[:, 2:7], tools, atol=1e-9)
    np.testing.assert_allclose(rows[:, 12:17], commands, atol=1e-9)
    assert np.ptp(rows[:, 2:7], axis=0).min() > 0.01
    assert log.clipped == info["clipped"] > 0
    assert log.saturated == info["saturated"]


def test_commands_are_poses_of_the_tool_in_the_arms_base():
    driver = HandDriver()
    run_policy(lambda o, i: np.array([1, 0, 0, 0, -1]), setup(driver), steps=2)
    pose, aperture = driver.commands[0]
    tool = np.linalg.inv(base_from_table()) @ pose
    np.testing.assert_allclose(tool[:3, 3], [0.024, 0.265, 0.25], atol=1e-12)
    np.testing.assert_allclose(tool[:3, :3], np.diag([1, -1, -1]), atol=1e-12)
    assert aperture == pytest.approx(0.14 - 0.042)
    assert driver.calls == ["rest", "command", "command", "stop"]


def test_a_dry_run_looks_and_decides_but_moves_nothing():
    driver, policy = HandDriver(), Scripted()
    log = run_policy(policy, setup(driver), steps=5, dry_run=True)
    assert driver.calls == ["stop"]
    assert log.dry_run
    assert log.steps == 5
    assert len(policy.seen) == 6
    np.testing.assert_array_equal(driver.world.tool, [0.0, 0.265, 0.25])
    # The command still runs ahead, up to its tether.
    assert np.ptp(log.column("command_z")) > 0


def broken(policy=nothing, at=3, **changes):
    """A setup whose parts break at a step; the log, or the error."""
    driver = HandDriver()
    count = [0]

    def patch(name, value):
        right = getattr(driver, name)

        def wrong(*arguments):
            count[0] += 1
            return value(right(*arguments)) if count[0] > at else right(*arguments)

        setattr(driver, name, wrong)

    for name, value in changes.items():
        patch(name, value)
    return driver, policy, setup(driver, limits=Limits(frozen=None, refusals=4))


def shifted(x=0.0, roll=0.0):
    """A reading that is off."""

    def change(reading):
        pose = np.array(reading.base_from_tool)
        pose[0, 3] += x
        turn = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
        pose[:3, :3] = turn @ pose[:3, :3]
        return Reading(pose, reading.aperture)

    return change


@pytest.mark.parametrize(
    ("end", "changes"),
    [
        (End.BAD_READING, {"measure": lambda r: Reading(np.full((4, 4), np.nan), r.aperture)}),
        (End.BAD_READING, {"measure": lambda r: Reading(r.base_from_tool, np.nan)}),
        (End.BAD_READING, {"measure": lambda r: Reading(r.base_from_tool[:3], r.aperture)}),
        (End.BAD_READING, {"measure": lambda r: Reading(np.diag([1, 1, 2, 1]) @ r.base_from_tool, r.aperture)}),
        (End.JUMP, {"measure": shifted(x=0.12)}),
        (End.OUTSIDE, {"measure": shifted(x=0.30)}),
        (End.TILT, {"measure": shifted(roll=0.3)}),
        (End.BAD_READING, {"measure": lambda r: Reading(r.base_from_tool, 1000 * r.aperture)}),
        (End.BAD_READING, {"measure": lambda r: Reading(r.base_from_tool, -0.5)}),
        (End.BAD_READING, {"measure": lambda r: Reading(r.base_from_tool, None)}),
        (End.BAD_READING, {"measure": lambda r: (r.base_from_tool, r.aperture)}),
        (End.REFUSED, {"command": lambda answer: False}),
        (End.REFUSED, {"command": lambda answer: np.False_}),
    ],
)
def test_a_guard_ends_the_episode_and_stops_the_arm(end, changes):
    driver, policy, chosen = broken(**changes)
    log = run_policy(policy, chosen)
    assert log.end == end
    assert 0 < log.steps < 10
    assert driver.calls[-1] == "stop"
    assert log.refused == (4 if end == End.REFUSED else 0)


@pytest.mark.parametrize("action", [[np.nan, 0, 0, 0, 0], [0, 0, 0, 0], [np.inf] * 5, "up", None])
def test_an_action_that_is_none_is_never_commanded(action):
    driver, seen = HandDriver(), []

    def policy(observation, info):
        seen.append(1)
        return np.zeros(5) if len(seen) < 4 else action

    log = run_policy(policy, setup(driver))
    assert log.end == End.BAD_ACTION
    assert driver.calls == ["rest", "command", "command", "stop"]


def test_a_camera_that_hangs_ends_the_episode():
    driver = HandDriver()
    image = driver.image()
    driver.image = lambda: image
    log = run_policy(nothing, setup(driver, limits=Limits(frozen=6)))
    assert log.end == End.FROZEN
    assert log.steps == 6


def towards(observation, info):
    return np.array([1.0, 0.0, 0.0, 0.0, 0.0])


def test_an_arm_that_does_not_follow_ends_the_episode():
    """A state that nobody refreshes, or brakes that are on: the command runs ahead, the arm stays to the last bit."""
    driver = HandDriver()
    chosen = setup(driver, limits=Limits(frozen=6))
    driver.rest()
    reading = driver.measure()
    driver.measure = lambda: reading
    log = run_policy(towards, chosen)
    assert log.end == End.STUCK
    assert 6 < log.steps < 12
    assert driver.calls[-1] == "stop"
    # Where it is not asked to move, or not commanded at all, an arm may well stand still.
    assert run_policy(nothing, chosen, steps=30).end == End.TIME_OUT
    assert run_policy(towards, chosen, steps=30, dry_run=True).end == End.TIME_OUT
    # One that moves, however slowly, is not stuck.
    count = []

    def crawl():
        count.append(1)
        pose = np.array(reading.base_from_tool)
        pose[0, 3] += 1e-6 * len(count)
        return Reading(pose, reading.aperture)

    driver.measure = crawl
    assert run_policy(towards, chosen, steps=30).end == End.TIME_OUT


def test_an_opening_in_another_unit_is_told_before_the_episode():
    driver = HandDriver()
    right = driver.measure
    driver.measure = lambda: Reading(right().base_from_tool, 1000 * right().aperture)
    with pytest.raises(InputError, match=r"an opening that is not within 0 to 0\.14 m"):
        run_policy(nothing, setup(driver))
    assert driver.calls == ["rest", "stop"]


def test_the_arm_holds_although_ctrl_c_is_pressed_again():
    driver, log = HandDriver(), EpisodeLog()
    stop, pressed = driver.stop, []

    def interrupted():
        pressed.append(1)
        if len(pressed) < 3:
            raise KeyboardInterrupt
        stop()

    def fail():
        raise OSError("cable")

    driver.stop = interrupted
    # At the end of a sound episode, and after an error.
    with pytest.raises(KeyboardInterrupt):
        run_policy(nothing, setup(driver), steps=2, log=log)
    assert (driver.calls[-1], len(pressed), log.end) == ("stop", 3, End.TIME_OUT)
    pressed.clear()
    driver.image = fail
    with pytest.raises(KeyboardInterrupt):
        run_policy(nothing, setup(driver), log=log)
    assert (driver.calls[-1], len(pressed), log.end) == ("stop", 3, End.ERROR)


@pytest.mark.parametrize("answer", [0, 1, "ok", np.array([True, False]), [0.1, 0.2]])
def test_an_answer_that_may_mean_either_ends_the_episode(answer):
    """Many libraries return a status of 0 for a success."""
    driver = HandDriver()
    driver.answer = answer
    with pytest.raises(InputError, match=r"driver: command: it answered .*Return False where"):
        run_policy(nothing, setup(driver), steps=5)
    assert driver.calls == ["rest", "command", "stop"]
    for fine in (True, np.True_, None):
        driver.answer = fine
        assert run_policy(nothing, setup(driver), steps=5).refused == 0


def test_the_last_attempt_to_hold_heeds_no_signal():
    """Somebody who presses Ctrl-C all the time, while the driver waits for the arm."""
    driver, begun = HandDriver(), []

    def slow():
        begun.append(1)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
        driver.calls.append("stop")

    driver.stop = slow
    before = {number: signal.signal(number, signal.default_int_handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with pytest.raises(KeyboardInterrupt):
            run_policy(nothing, setup(driver), steps=2)
        assert signal.getsignal(signal.SIGINT) == signal.getsignal(signal.SIGTERM) == signal.default_int_handler
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert (driver.calls[-1], len(begun)) == ("stop", 3)


def test_a_stop_that_failed_once_is_called_again_and_told(caplog):
    driver, tried = HandDriver(), []
    stop = driver.stop

    def fails_once():
        tried.append(1)
        if len(tried) == 1:
            raise OSError("no answer of the controller")
        stop()

    driver.stop = fails_once
    with caplog.at_level("WARNING", "gsbridge"):
        assert run_policy(nothing, setup(driver), steps=2).end == End.TIME_OUT
    assert driver.calls[-1] == "stop"
    assert "OSError: no answer of the controller" in caplog.text


def test_an_error_of_the_stop_itself_is_told_after_three_tries():
    driver, tried = HandDriver(), []

    def fail():
        tried.append(1)
        raise OSError("no connection")

    driver.stop = fail
    with pytest.raises(OSError, match="no connection"):
        run_policy(nothing, setup(driver), steps=2)
    assert len(tried) == 3


def test_late_steps_are_counted_and_not_made_up_for():
    driver = HandDriver()
    clock = SlowClock(driver.world)
    calls = []

    def policy(observation, info):
        calls.append(clock.now())
        clock.time += 0.13 if len(calls) == 5 else 0.01
        return np.zeros(5)

    log = run_policy(policy, setup(driver, clock), steps=10)
    assert log.end == End.TIME_OUT
    assert log.overruns == 1
    assert log.worst_late_s == pytest.approx(0.08)
    # The first call is the warm-up. Then 20 per second, one late step, and 20 per second again.
    np.testing.assert_allclose(np.diff(calls)[1:], [0.05] * 3 + [0.13] + [0.05] * 5, atol=1e-6)
    stalled = SlowClock(driver.world)

    def slow(observation, info):
        stalled.time += 0.6
        return np.zeros(5)

    driver.commands.clear()
    log = run_policy(slow, setup(driver, stalled))
    assert log.end == End.STALLED
    assert log.steps == 1
    # The arm is not sent anywhere by what it was like before.
    assert driver.commands == []


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
@pytest.mark.parametrize("where", ["policy", "image", "measure", "command", "rest"])
def test_whatever_is_raised_stops_the_arm_and_is_passed_on(error, where):
    driver, log = HandDriver(), EpisodeLog()

    def fail(*arguments):
        raise error("cable")

    count = []

    def policy(observation, info):
        count.append(1)
        if len(count) == 4:
            if where == "policy":
                fail()
            setattr(driver, where, fail)
        return np.zeros(5)

    if where == "rest":
        driver.rest = fail
    with pytest.raises(error):
        run_policy(policy, setup(driver), log=log)
    assert driver.calls[-1] == "stop"
    assert log.end == (End.INTERRUPTED if error is KeyboardInterrupt else End.ERROR)
    assert log.steps == {"rest": 0, "policy": 2, "command": 2}.get(where, 3)
    assert ("cable" in log.error) == (error is RuntimeError)


def test_an_episode_may_end_early():
    driver = HandDriver()
    log = run_policy(nothing, setup(driver), until=lambda: len(driver.commands) == 7)
    assert log.end == End.DONE
    assert log.steps == 7


def test_the_arm_must_stand_where_episodes_begin():
    driver = HandDriver()
    chosen = setup(driver)
    chosen.interface.check_start(np.eye(4))
    rest = np.eye(4)
    rest[:3] = np.diag([1, -1, -1, 1])[:3]
    rest[:3, 3] = [0.0, 0.265, 0.33]
    object.__setattr__(chosen.interface, "table_from_tool_at_rest", rest)
    with pytest.raises(InputError, match=r"-80\) mm"):
        run_policy(nothing, chosen)
    assert driver.calls == ["rest", "stop"]
    rest[2, 3] = 0.26
    assert run_policy(nothing, chosen, steps=3).steps == 3
    driver.base_from_table = driver.base_from_table @ np.diag([1.0, -1.0, -1.0, 1.0])
    object.__setattr__(chosen.interface, "table_from_tool_at_rest", None)
    with pytest.raises(InputError, match="tilt"):
        run_policy(nothing, chosen)


def test_a_camera_that_moved_since_the_training_is_refused():
    found = interface()
    mount = nominal.flange_from_camera()
    object.__setattr__(found, "flange_from_camera", mount)
    assert found.check_mount(registration()) == pytest.approx((0, 0), abs=1e-7)
    moved = np.array(mount)
    moved[0, 3] += 0.02
    object.__setattr__(found, "flange_from_camera", moved)
    with pytest.raises(InputError, match="20 mm"):
        Setup(found, HandDriver(), registration())


@pytest.mark.parametrize(
    ("shift", "degrees", "refused"), [(0.03, 0, False), (0.08, 0, True), (0.0, 10, False), (0.0, 11, True)]
)
def test_a_table_that_was_moved_too_far_is_told_before_the_arm_moves(shift, degrees, refused):
    """Shifted, or turned about the middle of the board, with the tool at rest 0.265 m beside it as the nominal arm's."""
    found, turn = interface(), np.radians(degrees)
    rest = np.diag([1.0, -1.0, -1.0, 1.0])
    rest[:3, 3] = [0.0, 0.265, 0.25]
    object.__setattr__(found, "table_from_tool_at_rest", rest)
    object.__setattr__(found, "base_from_table", base_from_table())
    found.check_table(registration())
    moved = np.eye(4)
    moved[:2, :2], moved[0, 3] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]], shift
    there = Registration(base_from_table() @ moved, nominal.flange_from_camera())
    driver = HandDriver()
    if not refused:
        found.check_table(there)
        return
    with pytest.raises(InputError, match=f"(80|51) mm and {degrees} degrees from where"):
        Setup(found, driver, there)
    assert driver.calls == []


def test_intrinsics_come_from_the_driver_or_the_registration():
    driver = HandDriver()
    driver.camera = None
    with pytest.raises(InputError, match="intrinsics"):
        Setup(interface(), driver, registration())
    wide = Camera(640, 480, 600.0, 600.0, 320.0, 240.0)
    assert Setup(interface(), driver, registration(camera=wide)).rectify.source == wide
    driver.camera = wrist_camera(64)
    assert Setup(interface(), driver, registration(camera=wide)).rectify.source == driver.camera


def test_the_interface_is_what_the_training_had():
    env = hand_environment(position_step=0.02, yaw_step=0.1)
    found = interface(position_step=0.02, yaw_step=0.1)
    assert found.settings == env.settings
    assert found.workspace == env.workspace
    assert found.target().scale == env.target.scale
    assert found.control_hz == 20
    for key in ("environment", "robot", "control_hz"):
        content = spec()
        del content[key]
        with pytest.raises(InputError, match="does not say"):
            PolicyInterface.of(content)
    content = spec()
    content["action"]["tether"] = 2.5
    with pytest.raises(InputError, match="another way"):
        PolicyInterface.of(content)


def test_a_worlds_clock_steps_it():
    driver = HandDriver()
    steps = []
    driver.world.step = lambda: steps.append(1)
    clock = WorldClock(driver.world, 0.05)
    for k in range(1, 4001):
        clock.wait_until(k * 0.05)
        assert len(steps) == k
    clock.wait_until(0.0)
    assert len(steps) == 4000


def test_joint_commands_keep_to_the_arms_speed_and_to_the_tools_path():
    """As the mirror's arm: all joints slow down together, so that the tool goes straight, only more slowly."""
    arm = JointArm(robot().urdf.parent)
    limits, now = arm.kinematics.arm_limits, arm.rest_posture
    begin = tool_pose(arm.kinematics, now)
    goal = np.array(begin)
    goal[:3, 3] += [0.10, 0.12, -0.10]
    wanted = arm.joints_for(goal, now)
    assert (np.abs(wanted - now) / (limits.velocity * 0.05)).max() > 2.0
    for _ in range(100):
        after = arm.next_joints(goal, now)
        assert (np.abs(after - now) <= limits.velocity * 0.05 + 1e-12).all()
        tool = tool_pose(arm.kinematics, after)
        # Between begin and goal in height, and upright to a degree or two on the way.
        assert goal[2, 3] - 2e-3 <= tool[2, 3] <= begin[2, 3] + 2e-3
        assert tool[2, 2] < -np.cos(np.radians(3.0))
        if np.allclose(after, now):
            break
        now = after
    np.testing.assert_allclose(tool_pose(arm.kinematics, now), goal, atol=1e-4)
    goal[:3, 3] = [3.0, 0.0, 0.2]
    assert arm.next_joints(goal, now) is None
