"""What the pages show is tried: commands are understood by what they call, and Python runs, with made-up data where it asks for
some. The blocks of docs/library.md are run by test_public_names, those of docs/simulator.md on a finished toy."""

import re
import subprocess
import sys
import types

import numpy as np
import pytest
from doc_blocks import NOT_RUN, PAGES, ROOT, blocks, commands, not_run, program
from robot_fixture import robot
from snakemake.cli import get_argument_parser
from test_gap_image import hidden_case, site  # noqa: F401

import gsbridge.effects.images.exposure as exposure
import gsbridge.effects.joints.viscous as viscous
from gsbridge.cli import parser
from gsbridge.robot.kinematics import Kinematics

COMMANDS = [pytest.param(words, id=f"{page.name}-{' '.join(words)[:60]}") for page in PAGES for words in commands(page)]
TRIED = {
    "docs/library.md": 3,
    "docs/simulator.md": 3,
    "docs/splats.md": 1,
    "docs/gap.md": 1,
    "docs/gap_images.md": 2,
    "docs/deployment.md": 1,
    "docs/architecture.md": 1,
}
"""Blocks of Python by page, all of which are tried somewhere: another one wants a test, too."""


def test_every_block_of_python_is_tried():
    found = {page.relative_to(ROOT).as_posix(): len(blocks(page, "python")) for page in PAGES}
    assert {page: count for page, count in found.items() if count} == TRIED


def test_every_command_is_planned_or_named_with_what_keeps_it_from_being_run():
    """Snakemake's are planned by tests/rules/test_doc_targets."""
    found = {
        command: not_run(command.split(" ")) for command in {" ".join(words) for page in PAGES for words in commands(page)}
    }
    left = [command for command, start in found.items() if start is None]
    assert [command for command in left if not command.startswith(("snakemake ", "gsbridge run "))] == []
    assert set(found.values()) - {None} == set(NOT_RUN)


@pytest.mark.parametrize("words", COMMANDS)
def test_commands_are_understood(words):
    name = program(words)
    if name == "snakemake":
        get_argument_parser().parse_args(words[1:])
    elif name == "gsbridge" and words[1] == "run":
        # Its arguments are snakemake's.
        get_argument_parser().parse_args(words[2:])
    elif name == "gsbridge":
        parser().parse_args(words[1:])
    elif name == "python" and words[1].startswith("benchmarks/"):
        script = ROOT / words[1]
        helped = subprocess.run([sys.executable, str(script), "--help"], capture_output=True, text=True, cwd=ROOT, check=True)
        for word in words[2:]:
            assert not word.startswith("--") or word in helped.stdout, f"{words[1]} knows no {word}"
    elif name == "make":
        assert len(words) == 2
        # With `--always-make`, since make prints nothing about targets that are up to date.
        call = ["make", "--dry-run", "--always-make", words[1]]
        would = subprocess.run(call, capture_output=True, text=True, cwd=ROOT, check=True).stdout
        assert re.search(r"touch|snakemake|gsbridge run|pytest|ruff", would)
    else:
        # All other commands only make an environment and install into it.
        assert name in (".", "pip", "python"), name
        assert name != "python" or words[1] in ("-m", "-c")


def shown_effect(page, module, name):
    """The class that a page shows, with the imports of the module that holds the real one."""
    known = {key: value for key, value in vars(module).items() if key != name}
    exec(compile(blocks(ROOT / page, "python")[-1], page, "exec"), known)
    return known[name]


@pytest.mark.parametrize(
    ("page", "module", "name"), [("docs/gap.md", viscous, "Viscous"), ("docs/gap_images.md", exposure, "Exposure")]
)
def test_effects_of_the_pages_are_those_of_the_catalogue(page, module, name):
    shown, real = shown_effect(page, module, name), getattr(module, name)
    for key in ("name", "title", "hook", "parameters", "signature", "confused_with", "tell_apart", "figures"):
        assert getattr(shown, key, None) == getattr(real, key, None), key


def test_the_page_s_exposure_doubles_the_light():
    seen = []
    shooting = types.SimpleNamespace(on_light=lambda stage, act: seen.append((stage, act(np.full(3, 0.2, np.float32), None))))
    for effect in (shown_effect("docs/gap_images.md", exposure, "Exposure"), exposure.Exposure):
        effect().apply(shooting, {"stops": 1.0})
    assert seen[0][0] == seen[1][0]
    np.testing.assert_allclose([light for _, light in seen], 0.4)


def test_photos_are_diagnosed_as_the_page_shows(site, capsys):  # noqa: F811
    """With photos in which the exposure is another one."""
    case = hidden_case(site, {"exposure": 0.2})
    text = blocks(ROOT / "docs/gap_images.md", "python")[0]
    # The page builds pairs from arrays that a reader has; here every role gets those of its own.
    taken = ("camera", "before", "again", "after", "depths", "poses")
    call = f"Pairs({', '.join(taken)}, repeats=4, name=role)"
    assert text.count(call) == 1
    text = text.replace(call, f"Pairs(*(getattr(case[role], key) for key in {taken}), repeats=case[role].repeats, name=role)")
    exec(compile(text, "gap_images", "exec"), {"case": case})
    assert "exposure" in capsys.readouterr().out


def test_an_arm_of_ones_own_is_driven_as_the_page_shows(monkeypatch):
    """With an arm that follows at once and a camera that sees grey."""

    class Arm:
        def __init__(self, address):
            self.address, self.q = address, np.array(robot().record["rest_posture"], float)

        def joint_angles(self):
            return self.q

        def drive(self, joints, speed):
            self.q = np.array(joints)

        def follow(self, joints):
            self.q = np.array(joints)

        def hold(self):
            self.held = True

    class Gripper:
        at = 0.0

        def move(self, opening):
            self.at = opening

        def opening(self):
            return self.at

    class Eye:
        def __init__(self, width, height, fps):
            self.size = height, width, 3

        def newest_rgb(self):
            return np.full(self.size, 120, np.uint8)

    monkeypatch.setitem(sys.modules, "vendor", types.SimpleNamespace(Arm=Arm, Gripper=Gripper, Camera=Eye))
    known: dict = {}
    exec(compile(blocks(ROOT / "docs/deployment.md", "python")[0], "deployment", "exec"), known)
    arm = known["MyArm"](robot().folder, "192.168.1.5")
    arm.rest()
    start = arm.measure()
    assert start.aperture == pytest.approx(arm.dimensions.stroke)
    wanted = start.base_from_tool.copy()
    wanted[2, 3] -= 0.02
    assert arm.command(wanted, 0.05)
    chain = Kinematics.read(robot().urdf)
    found = chain.fk(np.append(arm.arm.q, robot().dimensions.open_angle))["tool"]
    np.testing.assert_allclose(found[:3, 3], wanted[:3, 3], atol=2e-3)
    assert arm.measure().aperture == 0.05
    assert arm.image().shape == (arm.camera.height, arm.camera.width, 3)
    far = wanted.copy()
    far[0, 3] += 3.0
    assert not arm.command(far, 0.05)
    arm.stop()
    assert arm.arm.held


def test_the_rule_of_the_page_is_written_as_ours_are(tmp_path):
    (tmp_path / "measure_gloss.smk").write_text(blocks(ROOT / "docs/architecture.md", "python")[0])
    subprocess.run([sys.executable, "-m", "snakefmt", "--check", str(tmp_path)], check=True, capture_output=True)
