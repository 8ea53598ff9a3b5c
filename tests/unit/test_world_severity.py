"""Severity: the documented ranges, the same directions at every severity, and what the arm and the object make of them."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from robot_fixture import robot

from gsbridge.errors import InputError
from gsbridge.meshes import Mesh
from gsbridge.reality.mirror.objects import make_object
from gsbridge.reality.world.bodies import true_body
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.model import Stand
from gsbridge.reality.world.physics import MirrorPhysics
from gsbridge.reality.world.severity import LINES, WORST, Severity, worsened
from gsbridge.reality.world.world_variants import LABORATORY, configured_world, world_variant
from gsbridge.robot.assembly import ARM_LINKS
from gsbridge.robot.nominal import base_from_table

LEVELS = range(WORST + 1)
NEUTRAL = Hidden()


def at(level, seed=11):
    return world_variant(1, seed, severity=Severity(level, level))


def distance(line, world, home):
    """How far a parameter is from where severity 0 has it. [components]."""
    return np.subtract(getattr(world, line.name), getattr(home, line.name)).reshape(-1)


def test_the_documented_table_is_the_one_that_is_drawn_from():
    page = (Path(__file__).parents[2] / "docs/mirror.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|[^|]*\| (\w+) \|((?: [\d.]+ \|){5}) [^|]{4,} \|$", page, re.MULTILINE)
    found = {name: (form, tuple(float(size) for size in sizes.split("|")[:-1])) for name, form, sizes in rows}
    assert found == {line.name: (line.form, line.sizes) for line in LINES}
    assert list(found) == [line.name for line in LINES]


def test_severity_nought_is_the_world_without_it():
    for seed in range(20):
        assert worsened(Hidden.draw(seed), seed, Severity()) == Hidden.draw(seed)
        assert world_variant(1, seed, severity=Severity()) == world_variant(1, seed)
        # What severity alone draws is neutral there.
        drawn = {item.name for item in dataclasses.fields(Hidden)} & {line.name for line in LINES if line.sizes[0] == 0}
        fresh = drawn - {"latency", "joint_friction", "mass", "full_well", "read_noise"}
        fresh = {name for name in fresh if not name.startswith(("friction", "light_"))}
        assert all(getattr(Hidden.draw(seed), name) == getattr(NEUTRAL, name) for name in fresh)


@pytest.mark.parametrize("line", LINES, ids=lambda line: line.name)
def test_the_same_seed_goes_the_same_way_and_farther(line):
    for seed in range(30):
        home = Hidden.draw(seed)
        steps = [distance(line, worsened(home, seed, Severity(level, level)), home) for level in LEVELS]
        for before, after in zip(steps[:-1], steps[1:], strict=True):
            assert (np.abs(after) >= np.abs(before) - 1e-15).all()
            # The deviation never changes its sign with severity.
            assert (after * before >= 0).all()
        if line.form != "least":
            assert np.abs(steps[-1]).max() > 0


@pytest.mark.parametrize("line", LINES, ids=lambda line: line.name)
def test_sizes_are_what_the_table_says(line):
    for seed in range(30):
        home = Hidden.draw(seed)
        for level in LEVELS[1:]:
            world, size = worsened(home, seed, Severity(level, level)), line.sizes[level]
            value, before = (np.reshape(getattr(found, line.name), -1) for found in (world, home))
            if line.form == "exact":
                assert value == size
            elif line.form == "least":
                assert before <= value
                assert value <= max(before, size)
            elif line.name == "object_com":
                assert 0.5 * size - 1e-12 <= np.linalg.norm(value) <= size + 1e-12
            else:
                share = value / before - 1 if line.form in ("down", "up") else value - before
                assert (np.abs(share) >= 0.5 * size - 1e-12).all()
                assert (np.abs(share) <= size + 1e-12).all()


def test_look_and_physics_are_graded_apart_and_the_laboratory_stays():
    look, both = world_variant(1, 5, severity=Severity(look=3)), world_variant(1, 5, severity=Severity(3, 3))
    physics = configured_world(1, {"seed": 5, "severity": {"physics": 3}, "hidden": {}}, "lab")
    home = world_variant(1, 5)
    for line in LINES:
        here, there = (look, physics) if line.part == "look" else (physics, look)
        assert getattr(here, line.name) == getattr(both, line.name)
        assert getattr(there, line.name) == getattr(home, line.name)
    for name in LABORATORY:
        assert getattr(both, name) == getattr(Hidden.draw(1), name)


def test_what_a_world_names_goes_before_its_severity():
    world = {"seed": 5, "severity": 4, "hidden": {"mass": 1.0}}
    assert configured_world(1, world, "lab") == world_variant(1, 5, {"mass": 1.0}, severity=Severity(4, 4))


@pytest.mark.parametrize("given", [5, -1, True, 1.5, "2"])
def test_a_severity_that_is_none_is_refused(given):
    with pytest.raises(InputError, match="severity"):
        Severity(look=given)


@pytest.mark.parametrize(
    "changes",
    [{"lost_commands": 1.5}, {"latency_jitter": 0.06}, {"readout": 0.04, "exposure_time": 0.02}, {"compression": 100}],
)
def test_shares_and_times_that_make_no_sense_are_refused(changes):
    with pytest.raises(InputError, match=next(iter(changes))):
        Hidden(**changes)


def physics(**hidden):
    return MirrorPhysics(robot(), Stand(base_from_table()), None, Hidden(**hidden))


def drive(world, steps=40):
    """The arm's true tool points, and those by its encoders. [steps, 3] each."""
    true, measured = [], []
    for _ in range(steps):
        world.command([0.05, 0.30, 0.15], 0.2, 0.10)
        world.step()
        true.append(world.body_poses()["tool"][:3, 3])
        base = world.kinematics.fk(world.joints()[0], ["tool"])["tool"]
        measured.append((np.linalg.inv(base_from_table()) @ base)[:3, 3])
    return np.array(true), np.array(measured)


def start(world, seed=3):
    world._rng, world._losses, world._delays = (np.random.default_rng([seed, k]) for k in (1, 3, 4))
    world.place(world.kinematics.rest, 0.14)
    return world


def test_an_encoders_offset_moves_the_arm_and_nobody_measures_it():
    offset = (0.002, -0.003, 0.001, 0.002, -0.002, 0.003, 0.0)
    plain, off = start(physics()), start(physics(encoder_offset=offset))
    np.testing.assert_allclose(off.joints()[0][:7], off.kinematics.rest, atol=1e-12)
    true, measured = drive(off)
    wanted = drive(plain)[0][-1]
    # By its encoders the arm stands where it was sent.
    np.testing.assert_allclose(measured[-1], wanted, atol=3e-4)
    # Truly it stands where forward kinematics puts the joints less their offsets.
    joints = off.joints()[0]
    pose = np.linalg.inv(base_from_table()) @ off.kinematics.fk(joints - np.append(offset, 0.0), ["tool"])["tool"]
    np.testing.assert_allclose(true[-1], pose[:3, 3], atol=1e-9)
    assert 2e-3 < np.linalg.norm(true[-1] - wanted) < 8e-3


def test_links_are_not_as_long_as_drawn_and_nobody_measures_it():
    """The tool stands where a chain of the shifted joints puts it; nominal kinematics, by which all plan, puts it elsewhere."""
    offset = 1e-3 * np.random.default_rng(4).uniform(-1.0, 1.0, (7, 3))
    off = start(physics(link_offset=tuple(offset.ravel())))
    np.testing.assert_allclose(off.joints()[0][:7], off.kinematics.rest, atol=1e-12)
    links = off.kinematics.fk(off.joints()[0], [*ARM_LINKS, "tool"])
    moved = sum(links[link][:3, :3] @ step for link, step in zip(ARM_LINKS, offset, strict=False))
    drawn, true = links["tool"], base_from_table() @ off.body_poses()["tool"]
    np.testing.assert_allclose(true[:3, 3] - drawn[:3, 3], moved, atol=1e-9)
    np.testing.assert_allclose(true[:3, :3], drawn[:3, :3], atol=1e-9)
    assert np.linalg.norm(moved) > 5e-4


def test_weight_that_is_not_compensated_hangs_in_the_servos():
    """At rest the servo of each joint carries what compensation leaves: gain times lag is that share of the weight's torque."""
    lags = []
    for error in (0.0, -0.05):
        world = start(physics(gravity_error=error))
        for _ in range(30):
            world.step()
        lags.append(world.data.qpos[world._q[:7]] - world._point[:7])
    weight = world.data.qfrc_bias[world._v[:7]]
    gains = -world.model.actuator_biasprm[:7, 1]
    np.testing.assert_allclose((lags[1] - lags[0]) * gains, -0.05 * weight, atol=0.02 * 0.05 * np.abs(weight).max())
    assert np.abs(weight).max() > 20


def test_commands_are_lost_and_late_by_chance():
    plain = drive(start(physics()))[0]
    none = start(physics(lost_commands=1.0))
    np.testing.assert_allclose(drive(none)[0], np.tile(drive(none, 1)[0], (40, 1)), atol=1e-4)
    late = drive(start(physics(latency_jitter=0.04)))[0]
    # Behind on the way, there in the end, and the same with the same seed.
    way = np.linalg.norm(plain - late, axis=1)
    assert way[:6].max() > 2e-3
    assert way[-1] < 2e-4
    np.testing.assert_array_equal(late, drive(start(physics(latency_jitter=0.04)))[0])
    assert np.abs(late - drive(start(physics(latency_jitter=0.04), 4))[0]).max() > 1e-4


def test_an_object_has_a_heavy_side(tmp_path):
    even = true_body("small_cube", 0, 1.0, tmp_path)
    heavy = true_body("small_cube", 0, 1.0, tmp_path, (0.1, -0.05))
    mesh, _ = make_object("small_cube", 0, 4.0)
    assert Mesh(mesh.vertices, mesh.faces).is_watertight()
    width = np.ptp(even.hull[:, :2], axis=0)
    np.testing.assert_allclose(heavy.centre - even.centre, [0.1 * width[0], -0.05 * width[1], 0.0], atol=1e-12)
    assert heavy.mass == even.mass
