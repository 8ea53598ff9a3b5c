"""A servo known from data sheets only: three parameters are far off at once, and the log was resampled."""

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml

from gsbridge.gap.workflow import run_case

MASS, LENGTH, GRAVITY = 0.5, 0.1, 9.81
STIFFNESS, DAMPING, ROTOR, SHARE = 0.9, 0.045, 0.0018, 0.3
STATED_STIFFNESS = 1.6
STEP = 2 * np.pi / 4096

URDF = f"""<robot name="pendulum">
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 -{LENGTH}"/><mass value="{MASS}"/>
    <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="axis" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="2" velocity="20"/></joint>
</robot>
"""


def swung(commands: np.ndarray, period: float) -> np.ndarray:
    """Angles of a pendulum on a geared servo, simulated here: dry friction takes a share of the torque in the gear."""
    angle, speed, inertia, fine = 0.0, 0.0, MASS * LENGTH**2 + ROTOR, 20
    out = []
    for command in commands:
        out.append(angle)
        for _ in range(fine):
            motor = STIFFNESS * (command - angle) - DAMPING * speed
            weight = -MASS * GRAVITY * LENGTH * np.sin(angle)
            free = speed + period / fine * (motor + weight) / inertia
            held = period / fine * SHARE * abs(motor) / inertia
            speed = np.sign(free) * max(abs(free) - held, 0.0)
            angle += period / fine * speed
    return np.array(out)


def written(path: Path, command) -> None:
    """A log as an encoder and a program for resampling leave it: sampled at 90 Hz or so, brought to 200 Hz, six digits."""
    time = np.arange(0.0, 8.0, 0.005)
    angle = swung(command(time), 0.005)
    seen = np.cumsum(np.random.default_rng(3).uniform(0.009, 0.013, 1000))
    seen = np.concatenate([[0.0], seen[seen < time[-1]], time[-1:]])
    counted = np.round(np.interp(seen, time, angle) / STEP) * STEP
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["time [s]", "command.axis [rad]", "position.axis [rad]"])
        for row in zip(time, command(time), np.interp(time, seen, counted), strict=True):
            out.writerow([f"{value:.6f}" for value in row])


def test_several_large_faults_of_a_servo_are_told_apart(tmp_path):
    (tmp_path / "pendulum.urdf").write_text(URDF)
    motions = {
        "fit": lambda t: 1.2 * np.sin(0.15 * (t + 2.0) ** 2 * 2.0) * np.minimum(t, 1.0),
        "select": lambda t: 0.9 * np.sin(1.7 * t) + 0.6 * np.sin(4.1 * t),
        "verify": lambda t: 0.7 * np.sin(2.6 * t) + 0.7 * np.sin(0.9 * t),
    }
    for role, command in motions.items():
        written(tmp_path / f"{role}.csv", command)
    controller = {"mode": "pd", "rate": 200, "stiffness": [STATED_STIFFNESS], "damping": [DAMPING], "gravity_compensation": 0}
    model = {"urdf": "pendulum.urdf", "controller": controller | {"between": "hold"}}
    (tmp_path / "model.yaml").write_text(yaml.safe_dump(model))
    case = {"model": "model.yaml", "records": {role: f"{role}.csv" for role in motions}}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(case))
    findings = run_case(tmp_path / "case.yaml", out=tmp_path / "out", bank_folder=tmp_path / "bank")
    account = findings["account"]
    found = {entry["name"]: entry for entry in account["entries"]}
    assert account["explained"] > 0.85
    assert {"gain_p", "load_friction"} <= set(found)
    assert found["gain_p"]["parameters"]["change"]["value"] == pytest.approx(STIFFNESS / STATED_STIFFNESS - 1.0, abs=0.08)
    assert found["load_friction"]["parameters"]["share"]["value"] == pytest.approx(SHARE, abs=0.1)
    # Neither effect is proven on its own, but neither is mistaken for a payload or a delay.
    first = {entry["name"] for entry in account["entries"][:2]}
    assert first == {"gain_p", "load_friction"}
