"""Scores of the choice of keyframes against a film whose motion and blur are known, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.geometry import Array


def keyframe_scores(chosen: Sequence[int], measured_px: Array, motion_px: Array, blurred: Array) -> dict[str, Any]:
    """How well a choice of keyframes avoids blur and spreads over the motion.

    Args:
        chosen: Increasing positions of the keyframes among the film's frames. [K].
        measured_px: Image motion from the keyframe before, as the stage measured it, film pixels. [K].
        motion_px: True image motion from the frame before, film pixels. [N].
        blurred: Whether a frame was shaken during its exposure. [N].

    Returns:
        frames, keyframes: their numbers, N and K.
        blurred_film_percent, blurred_chosen_percent: share of shaken frames in the film and among the keyframes.
        motion_scale, motion_error_percent: slope of measured against true motion between keyframes, and the root mean
            square residual of that fit, relative to the mean step. The slope need not be 1: the true motion is a mean over
            the table, the measured one a mean over the picture, and even spacing needs proportional values only.
        step_spread: standard deviation of the true steps between keyframes over their mean; 0 is perfectly even.
        still_chosen: keyframes among the frames before the camera first moves; more than one is a waste.
    """
    picked = np.asarray(chosen)
    path = np.cumsum(np.nan_to_num(motion_px))
    steps = np.diff(path[picked])
    measured = np.asarray(measured_px, dtype=np.float64)[1:]
    slope = float(measured @ steps / (steps @ steps))
    return {
        "frames": len(motion_px),
        "keyframes": len(picked),
        "blurred_film_percent": 100 * float(np.mean(blurred)),
        "blurred_chosen_percent": 100 * float(np.mean(np.asarray(blurred)[picked])),
        "motion_scale": slope,
        "motion_error_percent": 100 * float(np.sqrt(np.mean((measured / slope - steps) ** 2)) / steps.mean()),
        "step_spread": float(steps.std() / steps.mean()),
        "still_chosen": int((path[picked] <= 0).sum()),
    }


def write_keyframe_score(out: str | Path, *, keyframes_json: str | Path, truth_json: str | Path) -> None:
    """Score the keyframes of the dense film and write the record.

    Args:
        out: File to write.
        keyframes_json: Record of the capture stage.
        truth_json: What the mirror knows about the film.

    Raises:
        InputError: A file is missing, damaged, or not of a dense film.
    """
    keyframes, truth = read_json(keyframes_json), read_json(truth_json)
    try:
        motion = np.array([frame["motion_px"] for frame in truth["frames"]], dtype=np.float64)
        blurred = np.array([frame["blurred"] for frame in truth["frames"]], dtype=bool)
    except KeyError as error:
        raise InputError(truth_json, f"this film does not state its motion and blur ({error})", "Use the dense film") from error
    frames = keyframes["frames"]
    if len(frames) < 3 or keyframes["decoded"] != len(motion):
        raise InputError(keyframes_json, "these are not keyframes of this film", "Run the capture stage again")
    write_json(
        out,
        keyframe_scores(
            [frame["index"] for frame in frames], np.array([frame["motion_px"] for frame in frames]), motion, blurred
        ),
    )
