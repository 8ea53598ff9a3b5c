"""The command line `gsbridge`: tools for work by hand, and commands that start the workflow and tell its status."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from gsbridge import __version__
from gsbridge.capture.printing import write_sheet
from gsbridge.errors import GsbridgeError, InputError
from gsbridge.logs import start
from gsbridge.photogrammetry.board import SHEETS_M, standard_board, write_board

_ENDED_EARLY, _INTERRUPTED = 3, 130

_ABOUT = """\
Drive an arm with a trained policy: 20 times a second it takes the wrist camera's picture and the measured tool pose, lets the
policy decide, and commands the next tool pose. Commands stay inside the workspace of the training and within 60 mm of the tool.

Driver
  module:Class  your own arm: a Python class with camera, rest, measure, image, command, stop; docs/deployment.md has an example
  sim           the simulated world, judged by the rules of the task
  mirror        the mirror, likewise

With a real arm
  1. --dry-run first: pictures and decisions are logged, nothing is commanded, the arm does not move.
  2. Then --pose-set fixed --index 0 --trials trials.csv: you are told where to place the object, the episode runs for 4 s (6 s
     for pick_and_place), and you say whether it worked.
  Ctrl-C stops the arm at any time. Keep the emergency stop in your hand all the same.

Units: metres, radians, seconds. Angles told to a person are in degrees.
"""

_RUN = "run the workflow: snakemake with the arguments that follow, which goes on by itself after a run that was killed"
_STATUS = "where the workflow stands: jobs left, about how long they take, degraded stages; arguments as for run"

_CODES = """\
exit code: 0 done; 1 something given cannot be used; 2 wrong arguments; 3 an episode was stopped by a guard (see its .json in
--out); 130 stopped by Ctrl-C
"""


def parser() -> argparse.ArgumentParser:
    """The parser of the arguments of `gsbridge`."""
    out = argparse.ArgumentParser(prog="gsbridge", description="Tools beside the Snakemake workflow.")
    out.add_argument("--version", action="version", version=__version__)
    commands = out.add_subparsers(dest="command", required=True)
    _add_board(commands)
    _add_masks(commands)
    _add_workflow(commands)
    _add_run_policy(commands)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Run `gsbridge`; returns the exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        if given and given[0] in _WORKFLOW:
            return _WORKFLOW[given[0]](given[1:])
        options = parser().parse_args(given)
        return options.run(options)
    except KeyboardInterrupt:
        print("gsbridge: stopped", file=sys.stderr)
        return _INTERRUPTED
    except EOFError:
        print("gsbridge: a question was not answered, since the input has ended. Run it in a terminal", file=sys.stderr)
        return 1
    except GsbridgeError as error:
        print(f"gsbridge: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        named = f"{error.filename}: {error.strerror}. Check the path and its permissions" if error.filename else str(error)
        print(f"gsbridge: {named}", file=sys.stderr)
        return 1


def _add_board(commands: Any) -> None:
    about = "write the printable board of AprilTags for scale and registration"
    board = commands.add_parser("board", help=about, description=about)
    board.add_argument("path", type=Path, help="file to write: .pdf or .svg")
    board.add_argument("--sheet", choices=sorted(SHEETS_M), default="a4", help="paper size (default: a4)")
    board.add_argument("--layout", type=Path, help="also write the layout of the tags as JSON")
    board.set_defaults(run=_board)


def _board(options: argparse.Namespace) -> int:
    layout = standard_board(options.sheet)
    with _writing(options.path):
        write_sheet(layout, options.path)
    if options.layout:
        with _writing(options.layout):
            write_board(options.layout, layout)
    print(f"{options.path}: print it at 100 % on {options.sheet.upper()} and check the ruler on it")
    return 0


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Report a failed write under the name that the user gave, not under that of the temporary file beside it.

    Raises:
        InputError: The file cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise InputError(
            path, f"it cannot be written: {(error.strerror or str(error)).lower()}", "Name another file"
        ) from error


def _add_masks(commands: Any) -> None:
    about = "write a page of photos on which pixels can be read, to correct the masks of a scene by hand (docs/masks.md)"
    masks = commands.add_parser("masks", help=about, description=about)
    masks.add_argument("scene", metavar="SCENE", help="name of an object in config.yaml")
    masks.add_argument("--results", type=Path, default=Path("results"), metavar="FOLDER", help="results of the workflow")
    masks.add_argument("--config", type=Path, default=Path("config.yaml"), metavar="FILE", help="for points already given")
    masks.add_argument("--photo", action="append", default=[], metavar="NAME", help="photo to show; may be repeated")
    masks.add_argument("--out", type=Path, metavar="FILE", help="page to write (default: mask_sheet.html of the scene)")
    masks.set_defaults(run=_masks)


def _masks(options: argparse.Namespace) -> int:
    from gsbridge.configuration.faults import listed, near
    from gsbridge.configuration.whole import read_configuration
    from gsbridge.reading import load_yaml
    from gsbridge.report.pages.mask_sheet import write_mask_sheet
    from gsbridge.workflow_files import check_configuration_files

    if not options.config.exists():
        raise InputError(options.config, "there is no such file here", "Go to the project's folder, or name it with --config")
    check_configuration_files([options.config])
    content = load_yaml(options.config, "configuration", "Name the project's config.yaml with --config")
    scenes = read_configuration(content)["scenes"]
    objects = [name for name, scene in scenes.items() if scene["kind"] == "object"]
    if options.scene not in objects:
        problem = "it is a background, which has no masks" if options.scene in scenes else f"{options.config} has no such scene"
        raise InputError(options.scene, problem, f"{near(options.scene, objects)}Objects: {listed(objects)}")
    points = scenes[options.scene]["masks"]["points"]
    folder = options.results / "scenes" / options.scene
    out = options.out or folder / "mask_sheet.html"
    count = write_mask_sheet(options.scene, folder, out, options.photo, points)
    print(f"{out} shows {count} of the photos; write what you read into config.yaml, scenes: {options.scene}: masks: points")
    return 0


def _add_workflow(commands: Any) -> None:
    """Add the commands of `_WORKFLOW` to the help only; `main` passes their arguments to snakemake without parsing them."""
    for name, text in (("run", _RUN), ("status", _STATUS)):
        commands.add_parser(name, help=text, add_help=False)


def _helped(command: str, text: str, arguments: list[str]) -> bool:
    """Print the help of a command that takes snakemake's arguments, if they ask for help; tell whether they did.

    Passed on, `--help` would make snakemake print its own help; `status` would take that for a plan without jobs, and so for
    a finished run.
    """
    if not {"-h", "--help"}.intersection(arguments):
        return False
    print(f"usage: gsbridge {command} [arguments of snakemake]\n\n{text}\n\n`snakemake --help` lists the arguments.")
    return True


def _run(arguments: list[str]) -> int:
    from gsbridge.workflow_lock import start_workflow

    if not _helped("run", _RUN, arguments):
        start_workflow(arguments, lambda sentence: print(f"gsbridge: {sentence}", file=sys.stderr))
    return 0


def _status(arguments: list[str]) -> int:
    if _helped("status", _STATUS, arguments):
        return 0
    from gsbridge.run_status import run_status

    print("\n".join(run_status(arguments)))
    return 0


_WORKFLOW = {"run": _run, "status": _status}


def _add_run_policy(commands: Any) -> None:
    run = commands.add_parser(
        "run-policy",
        help="drive an arm, the simulation or the mirror with a trained policy",
        description=_ABOUT,
        epilog=_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    needed = run.add_argument_group("needed")
    needed.add_argument("--policy", type=Path, required=True, metavar="FOLDER", help="with policy.json and policy.safetensors")
    needed.add_argument("--driver", required=True, metavar="DRIVER", help="sim, mirror, or module:Class")
    needed.add_argument(
        "--registration", type=Path, required=True, metavar="FILE", help="registration.json: where table and camera are"
    )
    trials = run.add_argument_group("trials")
    trials.add_argument("--pose-set", choices=("fixed", "unseen", "outside"), help="set of start poses, 32 each")
    trials.add_argument("--index", metavar="N", help="start pose: 0 to 31, a range such as 0-7, or all")
    trials.add_argument("--trials", type=Path, metavar="FILE", help="CSV file to add a row to after each episode")
    trials.add_argument("--redo", action="store_true", help="repeat trials that the file holds; without it they are skipped")
    episode = run.add_argument_group("episode")
    episode.add_argument("--dry-run", action="store_true", help="command nothing; the arm stays where it is")
    episode.add_argument("--steps", type=int, metavar="N", help="control steps of 50 ms (default: as in the training)")
    episode.add_argument("--out", type=Path, metavar="FOLDER", help="write each episode's steps (.csv) and summary (.json)")
    episode.add_argument("--pictures", action="store_true", help="also keep the pictures that the policy saw (.npz)")
    episode.add_argument("--runtime", choices=("torch", "onnx"), default="torch", help="what computes the network")
    own = run.add_argument_group("your own driver")
    own.add_argument(
        "--option", action="append", default=[], metavar="NAME=VALUE", help="argument of the driver's class; may be repeated"
    )
    worlds = run.add_argument_group("drivers sim and mirror")
    worlds.add_argument("--results", type=Path, metavar="FOLDER", help="results of the workflow")
    worlds.add_argument("--object", metavar="SCENE", help="such as small_cube")
    worlds.add_argument("--background", metavar="SCENE", help="such as foam_pad")
    worlds.add_argument("--model", type=Path, metavar="FILE", help="simulation model, such as models/nominal.yaml (sim)")
    worlds.add_argument("--seed", type=int, default=0, help="seed of config.yaml, which the hidden parameters follow (mirror)")
    worlds.add_argument("--pieces", type=Path, metavar="FOLDER", help="keeps prepared shapes from run to run (mirror)")
    run.set_defaults(run=_run_policy)


def _run_policy(options: argparse.Namespace) -> int:
    # One thread: more would only wait for each other in a network this small. Libraries read the limit when they are imported,
    # so the imports come after it.
    start(1, None)
    from gsbridge.policy.deploy import Deployment, deploy
    from gsbridge.policy.safety import End

    wanted = Deployment(
        policy=options.policy, driver=options.driver, registration=options.registration, options=_options(options.option),
        results=options.results, item=options.object, background=options.background, model=options.model, seed=options.seed,
        pieces=options.pieces, runtime=options.runtime, pose_set=options.pose_set, index=options.index, trials=options.trials,
        redo=options.redo, out=options.out, pictures=options.pictures, steps=options.steps, dry_run=options.dry_run,
    )  # fmt: skip
    # A signal that ends the program must stop the arm, too. SIGINT is handled explicitly because a shell makes programs that it
    # starts in the background ignore it.
    numbers = [signal.SIGINT, signal.SIGTERM]
    # The terminal was closed, or the connection to it was lost. A user who asks for that to be ignored (nohup) means it.
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        done = deploy(wanted, input)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    judged = [verdict for _, verdict in done if verdict is not None]
    if judged:
        print(f"{sum(verdict.success for verdict in judged)} of {len(judged)} trials succeeded")
    early = [log.end.value for log, _ in done if log.end not in (End.TIME_OUT, End.DONE)]
    if early:
        print(f"gsbridge: {len(early)} of {len(done)} episodes were stopped early: {', '.join(early)}", file=sys.stderr)
    return _ENDED_EARLY if early else 0


def _options(pairs: list[str]) -> dict[str, Any]:
    """Arguments of a driver, from pairs NAME=VALUE. Values are read as YAML: 5 is a number, true a boolean.

    Raises:
        GsbridgeError: A pair is not NAME=VALUE, or a name is given twice.
    """
    out = {}
    for pair in pairs:
        name, sign, value = pair.partition("=")
        if not (sign and name.isidentifier()):
            raise GsbridgeError(f"--option {pair}: this is not NAME=VALUE. Write for instance --option address=192.168.1.5")
        if name in out:
            raise GsbridgeError(f"--option {name} is given twice. Leave one out")
        try:
            out[name] = yaml.safe_load(value)
        # PyYAML lets two of Python's errors pass: ValueError for an impossible date, RecursionError for very deep brackets.
        except (yaml.YAMLError, ValueError, RecursionError):
            out[name] = value
    return out


if __name__ == "__main__":
    sys.exit(main())
