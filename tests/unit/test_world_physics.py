"""The mirror's physics against analytic mechanics and the robot's own kinematics."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pytest
from robot_fixture import kinematics, robot
from scipy.spatial import ConvexHull

from gsbridge.errors import InputError
from gsbridge.geometry import rotation_from_quat
from gsbridge.meshes import Mesh
from gsbridge.reality.mirror.backgrounds import make_plate
from gsbridge.reality.mirror.objects import make_object
from gsbridge.reality.world import pieces
from gsbridge.reality.world.bodies import DENSITIES, body_of
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.model import OBJECT, Stand
from gsbridge.reality.world.physics import MirrorPhysics, build_physics
from gsbridge.reality.world.pieces import convex_pieces, plate_pieces
from gsbridge.robot.nominal import base_from_table
from gsbridge.tasks.grasp import judge
from gsbridge.tasks.outcome import Progress
from gsbridge.tasks.rules import Grasp
from gsbridge.tasks.world import World

_FOLDER = TemporaryDirectory(prefix="gsbridge-pieces-")
GRAVITY = 9.81


@cache
def cube():
    """The small cube, its mass not changed."""
    mesh, _ = make_object("small_cube", 0, 4.0)
    return body_of("small_cube", mesh, DENSITIES["small_cube"], convex_pieces(Mesh(mesh.vertices, mesh.faces), _FOLDER.name))


def world(**changes):
    return MirrorPhysics(robot(), Stand(base_from_table()), cube(), Hidden(**changes))


def run(physics, seconds):
    for _ in range(round(seconds / physics.model.opt.timestep)):
        mujoco.mj_step(physics.model, physics.data)


def throw(physics, height=0.0, velocity=(0.0, 0.0, 0.0)):
    """Put the object above its place with a velocity."""
    joint = physics.model.joint(OBJECT)
    physics.data.qpos[joint.qposadr[0] + 2] += height
    physics.data.qvel[joint.dofadr[0] : joint.dofadr[0] + 3] = velocity
    mujoco.mj_forward(physics.model, physics.data)


def test_it_is_a_world():
    assert isinstance(world(), World)


def test_a_dropped_object_rests_on_the_table():
    physics = world()
    physics.reset([0.02, 0.25, 0.4], 0)
    throw(physics, 0.02)
    run(physics, 1.0)
    for _ in range(2):
        physics.step()
    state = physics.state()
    assert abs(state.object_clearance[0]) < 0.2e-3
    assert np.abs(state.object_velocity).max() < 1e-4
    assert state.tilt()[0] < 1e-3
    weight = cube().mass * GRAVITY
    assert state.object_contact[0] == pytest.approx(weight, rel=1e-3)
    assert state.robot_contact[0] == 0.0
    np.testing.assert_array_equal(state.pad_forces, 0.0)


def test_nothing_moves_when_set_down():
    physics = world()
    pose = [0.05, 0.30, -0.7]
    physics.reset(pose, 0)
    for _ in range(20):
        physics.step()
    state = physics.state()
    np.testing.assert_allclose(state.object_position[0], [*pose[:2], 0.0], atol=0.1e-3)
    assert 2 * np.arctan2(state.object_quat[0, 3], state.object_quat[0, 0]) == pytest.approx(pose[2], abs=1e-3)


def test_an_object_is_placed_at_a_whole_pose():
    """As of one in the hand; what stands at x, y, yaw has the same pose in both ways of giving it."""
    physics, rest = world(), kinematics().rest
    lifted = np.eye(4)
    lifted[:3, :3] = rotation_from_quat([0.9, 0.2, -0.3, 0.25])
    lifted[:3, 3] = 0.04, 0.27, 0.12
    physics.place(rest, 0.06, lifted)
    np.testing.assert_allclose(physics.body_poses()[OBJECT], lifted, atol=1e-12)
    assert physics.state().object_clearance[0] > 0.05
    arm = {name: pose for name, pose in physics.body_poses().items() if name != OBJECT}
    physics.place(rest, 0.06, [0.04, 0.27, 0.5])
    standing = physics.body_poses()
    for name, pose in arm.items():
        np.testing.assert_allclose(standing[name], pose, atol=1e-12)
    physics.place(rest, 0.06, standing[OBJECT])
    np.testing.assert_allclose(physics.body_poses()[OBJECT], standing[OBJECT], atol=1e-12)


@pytest.mark.parametrize("pose", [np.diag([1.0, 1.0, -1.0, 1.0]), 2 * np.eye(4), [0.0, np.nan, 0.0], np.zeros(4)])
def test_a_pose_that_is_none_is_refused(pose):
    with pytest.raises(InputError, match="object pose"):
        world().place(kinematics().rest, 0.06, pose)


def test_sliding_stops_after_the_way_that_friction_allows():
    """A block that slides at v stops after v^2 / (2 mu g); a flat one does not tip."""
    friction, speed = 0.4, 0.5
    physics = world(friction_table=friction)
    physics.reset([0.0, 0.25, 0.0], 0)
    start = physics.state().object_position[0, 0]
    throw(physics, 0.0, (speed, 0.0, 0.0))
    run(physics, 0.6)
    physics.step()
    way = physics.state().object_position[0, 0] - start
    assert way == pytest.approx(speed**2 / (2 * friction * GRAVITY), rel=0.03)


def test_the_object_lies_in_the_well_of_the_plate():
    centre = (0.02, 0.285)
    physics = build_physics(robot(), Stand(base_from_table(), centre), "small_cube", Hidden(), pieces=_FOLDER.name, seed=0)
    physics.place(kinematics().rest, 0.14, [*centre, 0.3])
    throw(physics, 0.010)
    run(physics, 0.5)
    physics.step()
    assert physics.state().object_clearance[0] == pytest.approx(0.004, abs=0.3e-3)


def test_pieces_of_the_plate_fill_it_and_nothing_else():
    """Heights of the pieces along rays from above, against the mesh itself."""
    mesh, _ = make_plate(0, 2.0)
    pieces = plate_pieces(mesh)
    rng = np.random.default_rng(0)
    radius, angle = 0.099 * np.sqrt(rng.uniform(size=60)), rng.uniform(0, 2 * np.pi, 60)
    points = np.c_[radius * np.cos(angle), radius * np.sin(angle)]
    section = ([0.0, 0.050, 0.062, 0.072, 0.085, 0.0975, 0.100], [0.004, 0.004, 0.005, 0.009, 0.0155, 0.020, 0.020])
    wanted = np.interp(radius, *section)
    found = np.full(len(points), -np.inf)
    for piece in pieces:
        planes = ConvexHull(piece).equations
        up = planes[planes[:, 2] > 1e-9]
        rest = planes[planes[:, 2] <= 1e-9]
        top = (-(points @ up[:, :2].T + up[:, 3]) / up[:, 2]).min(1)
        inside = (np.c_[points, top] @ rest[:, :3].T + rest[:, 3] <= 1e-6).all(1)
        found = np.where(inside, np.maximum(found, top), found)
    assert np.isfinite(found).all()
    assert np.abs(found - wanted).max() < 1.2e-3


def test_same_seed_same_trajectory_to_the_bit():
    traces = []
    for _ in range(2):
        physics, trace = MirrorPhysics(robot(), Stand(base_from_table()), cube(), Hidden.draw(7), None), []
        physics.reset([0.03, 0.25, 0.2], 5)
        for k in range(8):
            physics.command([0.03, 0.25, 0.25 - 0.02 * k], 0.02 * k, 0.14 - 0.01 * k)
            physics.step()
            trace.append(np.concatenate([*physics.joints(), *physics.state().object_position]))
        physics.reset([0.03, 0.25, 0.2], 5)
        trace.append(np.concatenate([*physics.joints(), *physics.state().object_position]))
        traces.append(np.stack(trace))
    np.testing.assert_array_equal(traces[0], traces[1])
    physics.reset([0.03, 0.25, 0.2], 6)
    assert not np.array_equal(physics.joints()[0], traces[0][-1][:8])


@pytest.mark.parametrize("late", [1, 20, 50])
def test_latency_delays_the_joints_by_itself(late):
    """In free motion a late world does the same, that much later."""
    prompt, tardy = world(), world(latency=late * 1e-3)
    traces = []
    for physics in (prompt, tardy):
        physics.reset([-0.1, 0.35, 0.0], 0)
        physics.command([0.03, 0.25, 0.20], 0.1, 0.10)
        trace = []
        start, speed = physics._point.copy(), np.full(8, 0.1) * np.append(np.ones(7), 0.0)
        for k in range(120):
            physics._control(start + speed * min(k + 1, 40) * 1e-3, speed * (k < 40))
            mujoco.mj_step(physics.model, physics.data)
            trace.append(physics.data.qpos[physics._q[:7]].copy())
        traces.append(np.array(trace))
    # The settling of a microradian before the first command differs.
    np.testing.assert_allclose(traces[1][late:], traces[0][:-late], atol=2e-6)
    assert np.abs(traces[1] - traces[0]).max() > 2e-5 * late


def test_the_arm_follows_and_agrees_with_forward_kinematics():
    physics = world()
    physics.reset([0.1, 0.35, 0.0], 0)
    target = np.array([0.0, 0.265, 0.25])
    for _ in range(10):
        target += [-0.005, 0.005, -0.015]
        physics.command(target, -0.3, 0.08)
        physics.step()
    lag = np.linalg.norm(physics.state().tool_position[0] - target)
    for _ in range(10):
        physics.step()
    state = physics.state()
    assert lag < 5e-3
    np.testing.assert_allclose(state.tool_position[0], target, atol=0.3e-3)
    assert state.aperture[0] == pytest.approx(0.08, abs=0.5e-3)
    q = physics.joints()[0]
    poses = kinematics().fk(q)
    table_from_base = np.linalg.inv(base_from_table())
    for name, pose in physics.body_poses().items():
        if name == OBJECT:
            continue
        # Fingers follow their coupling to a tenth of a millimetre, all else by construction.
        atol = 1e-4 if "pad" in name or "bar" in name else 1e-9
        np.testing.assert_allclose(pose, table_from_base @ poses[name], atol=atol if "bar" not in name else 1e-3)
    np.testing.assert_allclose(physics.camera_pose() @ physics.body_poses()["camera"], np.eye(4), atol=1e-12)


def test_it_grips_with_the_set_force_and_lifts():
    physics = world(grip_force=35.0)
    physics.reset([0.0, 0.25, 0.3], 0)
    target = np.array([0.0, 0.265, 0.25])
    progress, task = Progress.start(1), Grasp(hold_steps=5)
    for goal, aperture, steps in (((0.0, 0.25, 0.036), 0.14, 11), ((0.0, 0.25, 0.036), 0.0, 14), ((0.0, 0.25, 0.16), 0.0, 13)):
        for _ in range(steps):
            target = target + np.clip(np.array(goal) - target, -0.024, 0.024)
            physics.command(target, 0.3, aperture)
            physics.step()
            progress, outcome = judge(physics.state(), progress, task)
    state = physics.state()
    assert outcome.success[0]
    np.testing.assert_allclose(state.pad_forces[0], 35.0, rtol=0.05)
    assert state.aperture[0] == pytest.approx(0.058, abs=1e-3)
    assert state.object_contact[0] == 0.0
    # And lets go within a few steps, though it was told to close to 0 for much longer.
    for _ in range(3):
        physics.command(target, 0.3, 0.14)
        physics.step()
    assert (physics.state().pad_forces == 0.0).all()
    assert physics.state().aperture[0] > 0.065


def test_mass_factor_acts():
    physics = build_physics(robot(), Stand(base_from_table()), "small_cube", Hidden(mass=1.2), pieces=_FOLDER.name, seed=0)
    # A cube of 58 mm with edges of 2 mm radius; wood.
    assert physics.body.mass == pytest.approx(1.2 * 600.0 * 0.058**3, rel=0.01)
    assert physics.model.body(OBJECT).mass[0] == pytest.approx(physics.body.mass)


def test_physics_that_diverge_end_the_episode_and_leave_no_file(tmp_path, monkeypatch):
    """MuJoCo itself would put everything back to the begin, write a file where it stands, and go on."""
    monkeypatch.chdir(tmp_path)
    physics = world()
    physics.place(kinematics().rest, 0.1, np.zeros(3))
    throw(physics, 0.1, (1e11, 0.0, 0.0))
    with pytest.raises(InputError, match="diverged"):
        physics.step()
    assert list(tmp_path.iterdir()) == []
    physics.place(kinematics().rest, 0.1)
    physics.check_sound()


def test_pieces_are_found_again_by_content_and_code(tmp_path, monkeypatch):
    mesh, _ = make_object("small_cube", 0, 6.0)
    bare = Mesh(mesh.vertices, mesh.faces)
    first = convex_pieces(bare, tmp_path)
    (stored,) = tmp_path.iterdir()
    stamp = stored.stat().st_mtime_ns
    second = convex_pieces(bare, tmp_path)
    assert stored.stat().st_mtime_ns == stamp
    for one, two in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, two)
    convex_pieces(Mesh(1.01 * mesh.vertices, mesh.faces), tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    monkeypatch.setattr(pieces, "code_digest", lambda name: "edited")
    convex_pieces(bare, tmp_path)
    assert len(list(tmp_path.iterdir())) == 3
    assert min(piece[:, 2].min() for piece in first) == 0.0
    with pytest.raises(InputError, match="watertight"):
        convex_pieces(Mesh(mesh.vertices, mesh.faces[1:]), tmp_path)


def test_bad_input_is_refused():
    physics = world()
    with pytest.raises(InputError, match="no finite target"):
        physics.command([0.0, np.nan, 0.2], 0.0, 0.1)
    with pytest.raises(InputError, match="x, y, yaw"):
        physics.reset([0.0, 0.2], 0)
    with pytest.raises(InputError, match="unknown"):
        build_physics(robot(), Stand(base_from_table()), "teapot", Hidden(), pieces=Path(_FOLDER.name), seed=0)
    bare = build_physics(robot(), Stand(base_from_table()), None, Hidden(), pieces=Path(_FOLDER.name), seed=0)
    bare.step()
    with pytest.raises(InputError, match="no object"):
        bare.state()


def test_commands_out_of_reach_are_counted():
    physics = world()
    physics.reset([0.0, 0.25, 0.0], 0)
    physics.command([1.5, 0.25, 0.2], 0.0, 0.1)
    physics.step()
    assert physics.refused == 1
    assert physics.state().finite()[0]
