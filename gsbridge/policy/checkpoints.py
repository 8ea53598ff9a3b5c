"""Checkpoints of a training: one folder per checkpoint, which is complete or absent; the newest one counts.

| file | content |
|---|---|
| `run.json` | key of the training, counters, curve, state of the random generator |
| `learner.pt` | networks, optimisers, temperature, the agent's generator, best weights; read without pickles |
| `replay.npz` | the replay buffer |

Checkpoints are made between episodes. Every episode begins from a seed of its own, so no state of the environment needs to be
stored. A new checkpoint is complete before the old one is removed, so there is always one.
"""

from __future__ import annotations

import logging
import pickle
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from gsbridge.errors import InputError
from gsbridge.files import atomic_directory, read_json, write_json
from gsbridge.policy.replay import Replay

logger = logging.getLogger("gsbridge")

_NAME = "step"


@dataclass(frozen=True)
class Checkpoint:
    """State from which a training resumes.

    Args:
        run: Counters, curve, random generator.
        learner: State of the agent and best weights.
        replay: The replay buffer.
    """

    run: dict[str, Any]
    learner: dict[str, Any]
    replay: Replay


def save_checkpoint(folder: str | Path, key: Mapping[str, Any], checkpoint: Checkpoint) -> None:
    """Write a checkpoint and remove the older ones.

    Args:
        folder: Folder of the training's checkpoints.
        key: What the training depends on; only a training with an equal key resumes from the checkpoint.
        checkpoint: State to resume from; `run["step"]` names its folder.
    """
    folder = Path(folder)
    target = folder / f"{_NAME}{int(checkpoint.run['step']):09d}"
    with atomic_directory(target) as temporary:
        checkpoint.replay.save(temporary / "replay.npz")
        torch.save(checkpoint.learner, temporary / "learner.pt")
        write_json(temporary / "run.json", {"key": key, **checkpoint.run})
    for other in _all(folder):
        if other != target:
            shutil.rmtree(other, ignore_errors=True)


def load_checkpoint(folder: str | Path, key: Mapping[str, Any]) -> Checkpoint | None:
    """Load the newest checkpoint of a training; None if there is none, or if it belongs to another training.

    Raises:
        InputError: The checkpoint is damaged.
    """
    found = _all(Path(folder))
    if not found:
        return None
    newest = found[-1]
    run = read_json(newest / "run.json")
    if run.pop("key", None) != _as_json(key):
        logger.warning("the checkpoint in %s belongs to another training and is left aside", folder)
        return None
    try:
        learner = torch.load(newest / "learner.pt", weights_only=True)
    except (OSError, EOFError, RuntimeError, ValueError, KeyError, pickle.UnpicklingError) as error:
        raise InputError(newest, f"the checkpoint is damaged ({error})", "Delete the folder and train anew") from error
    return Checkpoint(run, learner, Replay.load(newest / "replay.npz"))


def _all(folder: Path) -> list[Path]:
    """List the complete checkpoints, oldest first."""
    return sorted(path for path in folder.glob(f"{_NAME}*") if path.is_dir())


def _as_json(value: Any) -> Any:
    """Return a value as it would come back from a JSON file."""
    if isinstance(value, Mapping):
        return {str(name): _as_json(item) for name, item in value.items()}
    return [_as_json(item) for item in value] if isinstance(value, list | tuple) else value
