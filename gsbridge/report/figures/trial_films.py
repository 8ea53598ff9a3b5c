"""Films of trials: all worlds side by side from the same start poses, as one animated picture that any browser plays."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from gsbridge.configuration.renderers import TITLES
from gsbridge.environment.trial_log import decode
from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.report.figures.paired_trials import STEP_S, ShownTrials, Start, Tried, cell_name, failures_first, read_starts
from gsbridge.report.tables.result_paths import CellPaths

MOST_FAILURES = 4
EVERY = 2
"""States of a trial per picture of the film, which shows 10 pictures a second."""
HOLD_S = 2.0
"""How long the last picture stays before the film begins anew, s."""
SIDE, GAP, BORDER, TEXT, HEAD = 148, 10, 3, 36, 40
"""Edge of a picture, room between trials, frame, lines below a trial and title above all, px."""
MOST_BYTES = 2_000_000
QUALITIES = (72, 55, 40, 25)
"""Qualities of the film, tried in this order: the first one with which it stays below `MOST_BYTES` is taken."""

PAPER, INK, SOFT = (251, 252, 253), (29, 39, 51), (91, 107, 123)
RUNNING, WON, LOST = (203, 211, 219), (44, 122, 75), (190, 44, 52)


def write_trial_film(cell: CellPaths, files: Sequence[ShownTrials], out: str | Path) -> None:
    """Write the film of one policy: failures first, then a success of each quadrant.

    Args:
        cell: What the policy learned.
        files: Trials of the policy; one world or several, the same for all seeds.
        out: WebP. It runs in real time, each trial until its end; the frame of a picture then tells the outcome.

    Raises:
        InputError: Trials are missing or damaged, or the film cannot be made small.
    """
    starts = read_starts(files)
    chosen = chosen_starts(starts)
    title = f"{cell.task.replace('_', ' ').capitalize()}: {cell_name(cell)}"
    frames = film_frames(chosen, title, _rates(starts, cell))
    durations = [round(1000 * STEP_S * EVERY)] * len(frames)
    durations[-1] = round(1000 * HOLD_S)
    write_film(frames, durations, out, MOST_BYTES)


def write_film(frames: Sequence[Array], durations: Sequence[int], out: str | Path, most_bytes: int) -> None:
    """Write an animated picture that repeats without end.

    Args:
        frames: uint8 [H, W, 3] each.
        durations: How long each frame stays, ms.
        out: WebP.
        most_bytes: Largest size, bytes; the best of `QUALITIES` that keeps to it is taken.

    Raises:
        InputError: The film is larger than `most_bytes` even at the lowest quality.
    """
    first, *rest = (Image.fromarray(frame) for frame in frames)
    for quality in QUALITIES:
        memory = io.BytesIO()
        first.save(
            memory, "WEBP", save_all=True, append_images=rest, duration=list(durations), loop=0, quality=quality, method=4,
            kmax=1000,
        )  # fmt: skip
        if memory.tell() <= most_bytes:
            break
    else:
        raise InputError(out, f"the film has {memory.tell() / 1e6:.1f} MB", "Show fewer trials")
    with atomic_file(out) as temporary:
        temporary.write_bytes(memory.getvalue())


def chosen_starts(starts: Sequence[Start]) -> list[Start]:
    """Choose at most `MOST_FAILURES` failures, from as many quadrants as possible, then a success of each quadrant."""
    ordered = failures_first(starts)
    failures = [start for start in ordered if not start.succeeded()]
    first_of_quadrant = _one_of_each_quadrant(failures)
    rest = [start for start in failures if start not in first_of_quadrant]
    shown = [start for start in failures if start in (first_of_quadrant + rest)[:MOST_FAILURES]]
    return shown + _one_of_each_quadrant([start for start in ordered if start.succeeded()])


def _one_of_each_quadrant(starts: Sequence[Start]) -> list[Start]:
    """Choose the middle start of each quadrant, so that no start is chosen by its looks."""
    out = []
    for quadrant in sorted({start.quadrant for start in starts}):
        here = [start for start in starts if start.quadrant == quadrant]
        out.append(here[len(here) // 2])
    return out


def film_frames(starts: Sequence[Start], title: str, subtitle: str) -> list[Array]:
    """Draw the pictures of the film. uint8 [H, W, 3] each.

    Args:
        starts: Starts that are shown, line by line.
        title, subtitle: Texts above all trials.
    """
    worlds = len(starts[0].trials)
    columns = min(len(starts), 2 if worlds > 1 else 4)
    width, height = worlds * (SIDE + 2 * BORDER), SIDE + 2 * BORDER + TEXT
    lines = -(-len(starts) // columns)
    size = (GAP + columns * (width + GAP), HEAD + lines * (height + GAP))
    canvas = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(canvas)
    draw.text((GAP, 6), title, fill=INK, font=label_font(15))
    draw.text((GAP, 24), subtitle, fill=SOFT, font=label_font(11))
    corners = []
    for number, start in enumerate(starts):
        left, top = GAP + (number % columns) * (width + GAP), HEAD + (number // columns) * (height + GAP)
        corners.append((left, top))
        _write_caption(draw, start, left, top + SIDE + 2 * BORDER + 2)
    ground = np.asarray(canvas)
    longest = max(len(trial.path) for start in starts for trial in start.trials.values())
    frames = []
    # The last state is always shown, whatever the step.
    for state in [*range(0, longest - 1, EVERY), longest - 1]:
        frame = ground.copy()
        for start, (left, top) in zip(starts, corners, strict=True):
            for place, (world, trial) in enumerate(start.trials.items()):
                x = left + place * (SIDE + 2 * BORDER)
                frame[top : top + SIDE + 2 * BORDER, x : x + SIDE + 2 * BORDER] = _tile(trial, world, state)
        frames.append(frame)
    return frames


def _tile(trial: Tried, world: str, state: int) -> Array:
    """Draw one world's picture in its frame."""
    last = len(trial.path) - 1
    picture = decode(trial.path.jpegs[min(state, last)])
    out = np.empty((SIDE + 2 * BORDER, SIDE + 2 * BORDER, 3), np.uint8)
    out[:] = RUNNING if state < last else WON if trial.success else LOST
    large = cv2.resize(picture, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC)
    # A dark strip behind the world's name keeps it legible on any picture.
    large[:16] = large[:16] // 2
    image = Image.fromarray(large)
    ImageDraw.Draw(image).text((5, 1), world.replace("_", " "), fill=(255, 255, 255), font=label_font(11))
    clock = f"{STEP_S * min(state, last):.1f} s"
    ImageDraw.Draw(image).text((SIDE - 5, 1), clock, fill=(255, 255, 255), font=label_font(11), anchor="ra")
    out[BORDER:-BORDER, BORDER:-BORDER] = np.asarray(image)
    return out


def _write_caption(draw: ImageDraw.ImageDraw, start: Start, left: int, top: int) -> None:
    """Write start and outcome below a trial."""
    x, y, yaw = start.pose
    where = f"{start.label}, quadrant {start.quadrant}: x {100 * x:.0f} cm, y {100 * y:.0f} cm, {np.degrees(yaw):.0f}°"
    draw.text((left + BORDER, top), where, fill=SOFT, font=label_font(11))
    pieces = [(f"{world.replace('_', ' ')}: {trial.outcome()}", trial.success) for world, trial in start.trials.items()]
    for place, (text, success) in enumerate(pieces):
        at = (left + BORDER + place * (SIDE + 2 * BORDER), top + 15)
        draw.text(at, text, fill=WON if success else LOST, font=label_font(12))


def _rates(starts: Sequence[Start], cell: CellPaths) -> str:
    """State how the policy was trained, and the successes of all trials."""
    counts = {world: sum(start.trials[world].success for start in starts) for world in starts[0].trials}
    trained = TITLES.get(cell.renderer, cell.renderer)
    rates = ", ".join(f"{count} of {len(starts)} in {world.replace('_', ' ')}" for world, count in counts.items())
    way = "" if cell.variant == "default" else f", variant {cell.variant}"
    # Say that failures come first only if there are any.
    order = "Failures first." if any(not start.succeeded() for start in starts) else "One start of each quadrant."
    return f"trained on {trained}{way}; success: {rates}. {order}"


def label_font(size: int) -> ImageFont.FreeTypeFont:
    """Load Pillow's own font, which is the same on every machine."""
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font
