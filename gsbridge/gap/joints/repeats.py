"""How far repeats of one motion differ beyond the noise."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.gap.formats.records import Record
from gsbridge.gap.joints.mechanism.mechanism_model import ControllerModel
from gsbridge.gap.joints.noise import white_noise
from gsbridge.geometry import Array

_BLOCK = 16
"""Samples per block over which the difference of two repeats is averaged; it keeps what changes more slowly than noise."""

_COMMANDED_ALIKE = 1e-6
"""Largest difference of two records' commands, rad, at which they count as repeats of one motion."""


def refuse_repeats(content: Mapping[str, Any], controller: ControllerModel, source: Path) -> None:
    """Refuse repeats where nothing leads two records back to one motion.

    Without feedback of positions two motions that begin a little apart stay apart. A replay follows each of them from its own
    measured states, so that their difference is no deviation that the replay leaves.

    Args:
        content: Content of the case.
        controller: How the joints are driven.
        source: File of the case, for messages.

    Raises:
        InputError: The case names repeats of a mechanism without feedback of positions.
    """
    if content.get("repeats") and not controller.repeatable:
        raise InputError(
            source, f"'repeats' tell nothing in mode {controller.mode}, where no controller leads them to the same positions",
            "Leave them out, and state a 'tolerance' if you know one",
        )  # fmt: skip


def scatter_of(record: Record, again: Record, source: Path) -> dict[str, Array]:
    """Estimate how far repeats of one motion differ beyond the noise: deviation per record, by kind of channel. Each [N].

    Args:
        record: A record.
        again: Its repeat.
        source: File of the repeat, for messages.

    Raises:
        InputError: The two records have different commands or are too short.
    """
    rows = min(len(record.time), len(again.time))
    sent = [item.commands.get("command", np.zeros((rows, 1)))[:rows] for item in (record, again)]
    if rows < 4 * _BLOCK or np.abs(sent[0] - sent[1]).max() > _COMMANDED_ALIKE:
        raise InputError(
            source, "it repeats no record: its commands differ", "Send the same commands again, as often per second"
        )
    out = {}
    for kind in set(record.measured) & set(again.measured):
        apart = (record.measured[kind][:rows] - again.measured[kind][:rows]) / np.sqrt(2.0)
        means = apart[: rows // _BLOCK * _BLOCK].reshape(-1, _BLOCK, apart.shape[1]).mean(axis=1)
        out[kind] = np.sqrt(np.maximum((means**2).mean(axis=0) - white_noise(apart) ** 2 / _BLOCK, 0.0))
    return out
