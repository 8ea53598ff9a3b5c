"""`gsbridge run-policy` from outside: own drivers, questions, files, exit codes, errors in plain words."""

import csv
import os
import signal
import subprocess
import sys
import textwrap
import time
from functools import partial
from pathlib import Path

import pytest
from driver_fixture import HandDriver, write_policy, write_registration

from gsbridge.cli import main
from gsbridge.files import read_json
from gsbridge.policy import deploy
from gsbridge.policy.onnx import export_onnx
from gsbridge.policy.robot_trials import COLUMNS

HERE = Path(__file__).resolve().parent

ARM = """
    import sys
    sys.path.insert(0, {here!r})
    from driver_fixture import HandDriver
    from gsbridge.cameras import Camera
    import numpy as np

    class Arm(HandDriver):
        made = []

        def __init__(self, address, port=1, fail=False):
            super().__init__()
            self.address, self.port, self.fail, self.count = address, port, fail, 0
            self.camera = Camera(160, 120, 150.0, 150.0, 80.0, 60.0)
            Arm.made.append(self)

        def command(self, base_from_tool, aperture):
            answer = super().command(base_from_tool, aperture)
            # No clock steps this world: it moves as it is told.
            self.world.step()
            return answer

        def image(self):
            self.count += 1
            if self.fail and self.count > 3:
                raise OSError("the cable fell out")
            return np.random.default_rng(self.count).integers(0, 256, (120, 160, 3), dtype=np.uint8)

        def stop(self):
            super().stop()
            print("stopped", flush=True)

    class Half:
        camera = None

    class Offline(HandDriver):
        def __init__(self):
            raise RuntimeError("no arm\\nat this address")

    class Blind(HandDriver):
        def __init__(self, camera="the left one"):
            super().__init__()
            self.camera = camera

    class Mirrored(Blind):
        def __init__(self):
            super().__init__(Camera(160, 120, -150.0, 150.0, 80.0, 60.0))

    class FiveNumbers(Blind):
        def __init__(self):
            super().__init__(Camera(160, 120, 150.0, 150.0, 80.0, 60.0, (0.1, -0.2, 0.0, 0.0, 0.01)))

    class Words(Blind):
        def __init__(self):
            super().__init__(Camera("wide", 120, 150.0, 150.0, 80.0, 60.0))

    class Stiff(HandDriver):
        command = None
"""


class Untroubled:
    """A clock by which a busy machine is never late."""

    def __init__(self):
        self.time = 0.0

    def now(self):
        return self.time

    def wait_until(self, moment):
        time.sleep(0.01)
        self.time = moment


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Policy, registration and a driver's module in the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(deploy, "WallClock", Untroubled)
    (tmp_path / "my_arm.py").write_text(textwrap.dedent(ARM).format(here=str(HERE)))
    (tmp_path / "broken.py").write_text("class Arm(")
    (tmp_path / "odd.csv").write_text(f"{','.join(COLUMNS)}\nfixed,left\n")
    os.mkfifo(tmp_path / "pipe")
    sys.modules.pop("my_arm", None)
    yield write_policy(tmp_path / "policy", max_steps=6), write_registration(tmp_path / "registration.json")
    sys.modules.pop("my_arm", None)


def command(files, *more, driver="my_arm:Arm"):
    policy, registration = files
    return ["run-policy", "--policy", str(policy), "--registration", str(registration), "--driver", driver, *more]


def answers(monkeypatch, *given):
    left = list(given)
    monkeypatch.setattr("builtins.input", lambda question: left.pop(0))
    return left


def test_a_trial_with_ones_own_arm(files, monkeypatch, capsys, tmp_path):
    left = answers(monkeypatch, "", "", "y", "", "", "n", "dropped")
    code = main(command(
        files, "--option", "address=10.0.0.2", "--option", "port=8", "--pose-set", "unseen", "--index", "2-3",
        "--trials", "t.csv", "--out", "logs",
    ))  # fmt: skip
    assert code == 0
    assert not left
    assert "1 of 2 trials succeeded" in capsys.readouterr().out
    with open(tmp_path / "t.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["pose_set"], row["index"], row["success"]) for row in rows] == [
        ("unseen", "2", "true"),
        ("unseen", "3", "false"),
    ]
    arm = sys.modules["my_arm"].Arm.made[-1]
    assert (arm.address, arm.port) == ("10.0.0.2", 8)
    assert arm.calls.count("command") == 12
    summary = read_json(tmp_path / "logs" / "unseen_02.json")
    assert summary["policy_sha256"] == read_json(files[0] / "policy.json")["sha256"]
    assert summary["end"] == "time_out"


def test_the_onnx_runtime_acts_alike(files, tmp_path):
    export_onnx(files[0])
    commands = []
    for runtime in ("torch", "onnx"):
        assert main(command(files, "--option", "address=a", "--runtime", runtime, "--out", runtime)) == 0
        commands.append(sys.modules["my_arm"].Arm.made[-1].commands)
    assert len(commands[0]) == 6
    for (pose, aperture), (other, opening) in zip(*commands, strict=True):
        assert pose == pytest.approx(other, abs=1e-6)
        assert aperture == pytest.approx(opening, abs=1e-6)


def test_a_dry_run_gives_no_command(files):
    assert main(command(files, "--option", "address=a", "--dry-run")) == 0
    assert sys.modules["my_arm"].Arm.made[-1].calls == ["stop"]


def test_an_error_of_the_driver_stops_the_arm(files, capsys):
    assert main(command(files, "--option", "address=a", "--option", "fail=true")) == 1
    assert "cable" in capsys.readouterr().err
    assert sys.modules["my_arm"].Arm.made[-1].calls[-1] == "stop"


def test_questions_without_anybody_to_answer_stop_the_arm(files, capsys, monkeypatch):
    def nobody(question):
        raise EOFError

    monkeypatch.setattr("builtins.input", nobody)
    assert main(command(files, "--option", "address=a", "--pose-set", "unseen", "--index", "2", "--trials", "t.csv")) == 1
    assert capsys.readouterr().err.startswith("gsbridge: a question was not answered")
    assert sys.modules["my_arm"].Arm.made[-1].calls[-1] == "stop"


def test_a_guard_has_an_exit_code_of_its_own(files, capsys, monkeypatch):
    monkeypatch.setattr(HandDriver, "command", lambda self, pose, aperture: False)
    assert main(command(files, "--option", "address=a", "--steps", "30")) == 3
    assert "refused" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "driver", "said"),
    [
        ([], "my_arm:Arm", "--option"),
        (["--option", "address"], "my_arm:Arm", "NAME=VALUE"),
        (["--option", "adress=1"], "my_arm:Arm", "adress"),
        ([], "my_arm", "module:Class"),
        ([], "my_leg:Arm", "my_leg"),
        ([], "my_arm:Leg", "Leg"),
        ([], "my_arm:Half", "rest, measure, image, command, stop"),
        ([], "my_arm:Offline", "RuntimeError: no arm at this address, in my_arm.py, line"),
        ([], "my_arm:Blind", "it is no Camera"),
        ([], "my_arm:Mirrored", "a focal length fx of -150 px"),
        ([], "my_arm:FiveNumbers", "is not four numbers. Give (k1, k2, p1, p2)"),
        ([], "my_arm:Words", "driver: camera: the camera is damaged"),
        ([], "my_arm:Stiff", "lacks command"),
        ([], "broken:Arm", "SyntaxError"),
        ([], "sys:exit", "cannot be made"),
        ([], ".my_arm:Arm", "'.my_arm:Arm' cannot be imported"),
        ([], "my_arm..x:Arm", "cannot be imported"),
        ([], ":Arm", "names no class"),
        ([], "my_arm:made.x", "cannot be imported"),
        (["--option", "address=a", "--option", "address=b"], "my_arm:Arm", "given twice"),
        (["--option", "fail=2001-99-99"], "my_arm:Arm", "address"),
        (["--steps", "-1"], "my_arm:Arm", "steps"),
        (["--steps", "9" * 30], "my_arm:Arm", "Give 1 to"),
        (["--seed", "-1"], "my_arm:Arm", "seed"),
        (["--seed", "9" * 30], "my_arm:Arm", "seed"),
        (["--pose-set", "fixed", "--index", "7-3"], "my_arm:Arm", "names no pose"),
        (["--pose-set", "fixed", "--index", "nan"], "my_arm:Arm", "names no pose"),
        (["--pose-set", "fixed", "--index", "-1"], "my_arm:Arm", "names no pose"),
        (["--pose-set", "fixed", "--index", "9" * 5000], "my_arm:Arm", "names no pose"),
        (["--out", "my_arm.py"], "my_arm:Arm", "--out cannot be written there"),
        (["--out", "/dev/null/logs"], "my_arm:Arm", "--out cannot be written there"),
        (["--out", "/proc/logs"], "my_arm:Arm", "--out cannot be written there"),
        (["--trials", "policy", "--pose-set", "fixed", "--index", "0"], "my_arm:Arm", "a folder, a device or a pipe"),
        (["--trials", "/dev/zero", "--pose-set", "fixed", "--index", "0"], "my_arm:Arm", "a folder, a device or a pipe"),
        (["--trials", "pipe", "--pose-set", "fixed", "--index", "0"], "my_arm:Arm", "a folder, a device or a pipe"),
        (["--trials", "my_arm.py/t.csv", "--pose-set", "fixed", "--index", "0"], "my_arm:Arm", "trials cannot be read"),
        (["--trials", "odd.csv", "--pose-set", "fixed", "--index", "0"], "my_arm:Arm", "its row 1 is no trial"),
        ([], "sim", "--pose-set"),
        (["--pose-set", "fixed"], "my_arm:Arm", "--index"),
        (["--pose-set", "fixed", "--index", "40"], "my_arm:Arm", "0 to 31"),
        (["--trials", "t.csv"], "my_arm:Arm", "--pose-set"),
        (["--trials", "t.csv", "--dry-run", "--pose-set", "fixed", "--index", "0"], "my_arm:Arm", "dry run"),
        (["--trials", "t.csv", "--steps", "3", "--pose-set", "fixed", "--index", "0"], "my_arm:Arm", "an episode is no trial"),
        (["--pictures"], "my_arm:Arm", "--out"),
        (["--steps", "0"], "my_arm:Arm", "steps"),
        (["--runtime", "onnx"], "my_arm:Arm", "policy.onnx"),
        (["--pose-set", "fixed", "--index", "0"], "sim", "--results"),
        (["--pose-set", "fixed", "--index", "0", "--option", "a=1"], "mirror", "takes no"),
        (["--pose-set", "fixed", "--index", "0", "--results", ".", "--object", "x", "--background", "y"], "sim", "--model"),
        (["--pose-set", "fixed", "--index", "0", "--results", ".", "--object", "x", "--background", "y"], "mirror", "'y'"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_said_in_one_line(files, capsys, more, driver, said):
    assert main(command(files, *more, driver=driver)) == 1
    told = capsys.readouterr().err.strip().splitlines()[-1]
    assert told.startswith("gsbridge: ")
    assert said in told


@pytest.mark.parametrize("name", ["policy", "registration"])
@pytest.mark.parametrize("place", [".", "/dev/null", "nothing", "my_arm.py", "a" * 5000, "odd.csv"])
def test_places_that_hold_no_file_are_named(files, capsys, name, place):
    given = dict(zip(("policy", "registration"), files, strict=True)) | {name: place}
    assert main(command((given["policy"], given["registration"]))) == 1
    told = capsys.readouterr().err.strip().splitlines()
    assert len(told) == 1
    assert told[0].startswith("gsbridge: ")


def test_missing_files_are_named(files, capsys, tmp_path):
    policy, registration = files
    assert main(command((tmp_path / "none", registration))) == 1
    assert "none/policy.json" in capsys.readouterr().err
    assert main(command((policy, tmp_path / "none.json"))) == 1
    assert "none.json" in capsys.readouterr().err


def test_arguments_that_are_missing_and_help(capsys):
    with pytest.raises(SystemExit) as left:
        main(["run-policy", "--driver", "sim"])
    assert left.value.code == 2
    with pytest.raises(SystemExit) as left:
        main(["run-policy", "--help"])
    assert left.value.code == 0
    told = capsys.readouterr().out
    for word in ("--dry-run", "--registration", "module:Class", "Ctrl-C", "exit code"):
        assert word in told


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_stops_the_arm(files, tmp_path, number):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE.parents[1]), str(HERE)])}
    arguments = command(files, "--option", "address=a", "--steps", "100000", "--out", "logs")
    code = f"""
        import sys
        from gsbridge.cli import main
        from gsbridge.policy import deploy
        from test_cli_run_policy import Untroubled
        deploy.WallClock = Untroubled
        sys.exit(main({arguments!r}))
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment, cwd=tmp_path, text=True,
        # As a shell starts what runs in the background.
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_IGN),
    )  # fmt: skip
    told = []
    try:
        for line in process.stderr:
            told.append(line)
            if "episode begins" in line:
                break
        process.send_signal(number)
        out, err = process.communicate(timeout=100)
    finally:
        process.kill()
    assert process.returncode == 130, "".join(told) + err
    assert "stopped" in out
    assert read_json(tmp_path / "logs" / "episode.json")["end"] == "interrupted"
