"""Score of the registration against the mirror's hidden layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.registration.result import pose_error, read_registration

CALIBRATED = ("base_from_table", "flange_from_camera")


def score_registration(registration: str | Path, truth: str | Path, out: str | Path) -> None:
    """Compare the registered poses with the true ones.

    Args:
        registration: `registration.json`.
        truth: JSON of the true poses, which the mirror's board capture wrote beside the photos.
        out: JSON {pose: {mm, deg}}.

    Raises:
        InputError: A file is missing or damaged.
    """
    found, content = read_registration(registration), read_json(truth)
    scores = {}
    for name in CALIBRATED:
        try:
            true = np.array(content[name], dtype=np.float64).reshape(4, 4)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(truth, f"the truth is damaged ({error!r})", "Film the board again") from error
        shift, turn = pose_error(getattr(found, name), true)
        scores[name] = {"mm": 1e3 * shift, "deg": float(np.rad2deg(turn))}
    write_json(out, scores)
