"""Films of a policy's trials from beside the table, each with what the wrist camera saw at the same moment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw

from gsbridge.environment.build import StageFiles
from gsbridge.environment.onlooker import OnlookerView
from gsbridge.environment.trial_log import decode
from gsbridge.geometry import Array
from gsbridge.report.figures.paired_trials import STEP_S, ShownTrials, Start, Tried, cell_name, failures_first, read_starts
from gsbridge.report.figures.trial_films import HOLD_S, INK, LOST, PAPER, RUNNING, SOFT, WON, label_font, write_film
from gsbridge.report.tables.result_paths import CellPaths

EVERY = 2
"""States of a trial per picture of the film, which shows 10 pictures a second."""
WIDTH, HEIGHT, WRIST = 400, 300, 104
"""Width and height of the onlooker's picture, and edge of the wrist camera's picture in its corner, px."""
GAP, BORDER, HEAD, TEXT = 10, 3, 40, 22
MOST_BYTES = 900_000
SUBTITLE = "from beside the table, drawn from splats (stand and outer ground: plain); in the corner, what the policy saw"


def write_onlooker_film(cell: CellPaths, files: Sequence[ShownTrials], scene: StageFiles, out: str | Path) -> None:
    """Film two starts of a policy: the quickest success and the first failure, or two successes where nothing failed.

    Args:
        cell: What the policy learned.
        files: Trials of the policy; one world or several, the same for all seeds.
        scene: Splats of object, table and robot. Every world is drawn with them, because the film shows where things stood; the
            corner shows what the camera of that world saw.
        out: WebP, in real time; the frame tells the outcome once a trial has ended.

    Raises:
        InputError: Trials or splats are missing or damaged, or the film cannot be made small.
    """
    chosen = told_starts(read_starts(files))
    view = OnlookerView.build(scene, WIDTH, HEIGHT)
    tiles = [
        (start, world, trial, view.pictures(trial.path, EVERY)) for start in chosen for world, trial in start.trials.items()
    ]
    worlds = len(chosen[0].trials)
    width, height = WIDTH + 2 * BORDER, HEIGHT + 2 * BORDER + TEXT
    size = (GAP + worlds * (width + GAP), HEAD + len(chosen) * (height + GAP))
    canvas = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(canvas)
    draw.text((GAP, 6), f"{cell.task.replace('_', ' ').capitalize()}: {cell_name(cell)}", fill=INK, font=label_font(15))
    draw.text((GAP, 24), SUBTITLE, fill=SOFT, font=label_font(11))
    places = []
    for number, (start, world, trial, _) in enumerate(tiles):
        left, top = GAP + number % worlds * (width + GAP), HEAD + number // worlds * (height + GAP)
        places.append((left, top))
        text = f"{world.replace('_', ' ')}, {start.label}: {trial.outcome()} after {trial.seconds:.1f} s"
        colour = WON if trial.success else LOST
        draw.text((left + BORDER, top + HEIGHT + 2 * BORDER + 3), text, fill=colour, font=label_font(12))
    ground = np.asarray(canvas)
    frames = []
    for moment in range(max(len(pictures) for *_, pictures in tiles)):
        frame = ground.copy()
        for (_, _, trial, pictures), (left, top) in zip(tiles, places, strict=True):
            frame[top : top + HEIGHT + 2 * BORDER, left : left + width] = trial_tile(trial, pictures, moment)
        frames.append(frame)
    write_film(frames, [round(1000 * STEP_S * EVERY)] * (len(frames) - 1) + [round(1000 * HOLD_S)], out, MOST_BYTES)


def told_starts(starts: Sequence[Start]) -> list[Start]:
    """Choose two starts: the one at which every world succeeded soonest, and the first failure.

    Where nothing failed, the second is the slowest success; where nothing succeeded, both are failures.
    """
    won = sorted(
        (start for start in starts if start.succeeded()), key=lambda start: max(t.seconds for t in start.trials.values())
    )
    lost = [start for start in failures_first(starts) if not start.succeeded()]
    return (won[:1] + lost[:1] + won[1:][-1:] + lost[1:2])[:2]


def trial_tile(trial: Tried, pictures: Sequence[Array], moment: int) -> Array:
    """Draw one trial's picture at a moment of the film, in its frame. uint8 [H, W, 3].

    Args:
        trial: The trial.
        pictures: What the onlooker saw of the trial, every `EVERY`th state and the last. [HEIGHT, WIDTH, 3] uint8 each.
        moment: Number of the film's picture; the last one stays when the trial is over.
    """
    last = len(pictures) - 1
    out = np.empty((HEIGHT + 2 * BORDER, WIDTH + 2 * BORDER, 3), np.uint8)
    out[:] = RUNNING if moment < last else WON if trial.success else LOST
    picture = pictures[min(moment, last)].copy()
    state = min(EVERY * moment, len(trial.path) - 1) if moment < last else len(trial.path) - 1
    seen = cv2.resize(decode(trial.path.jpegs[state]), (WRIST, WRIST), interpolation=cv2.INTER_CUBIC)
    picture[: WRIST + 2, : WRIST + 2] = 255
    picture[:WRIST, :WRIST] = seen
    out[BORDER:-BORDER, BORDER:-BORDER] = picture
    return out
