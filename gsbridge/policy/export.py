"""A policy as two files: `policy.safetensors` holds its weights, `policy.json` describes its inputs and outputs. No pickles.

`policy.json`: format, algorithm, settings of the training, digest of the weights; the observation with its preprocessing
(picture size, camera's angle of view, meaning and origin of `proprio`), the action with its scale, the settings of an episode,
and the robot's rest posture and mounts. A runner on a robot needs nothing else. `gsbridge.policy.onnx` adds `policy.onnx`, the
same network for programs without PyTorch.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor

from gsbridge.configuration.policy import PolicySettings
from gsbridge.environment.env import PROPRIO, PROPRIO_BOUND, PickEnvironment
from gsbridge.environment.rendering import FIELD_OF_VIEW
from gsbridge.environment.settings import IMAGE_SIZES
from gsbridge.errors import InputError
from gsbridge.files import atomic_file, read_json, versions, write_json
from gsbridge.geometry import Array
from gsbridge.policy.format import ACTION_NAMES, FORMAT, PROPRIO_NAMES, SPEC, WEIGHTS
from gsbridge.policy.networks import CHANNELS, HIDDEN, Actor
from gsbridge.policy.observation import PICTURE_OFFSET, PICTURE_SCALE, actor_input
from gsbridge.reading import refusing, regular_file
from gsbridge.sim.actions import SIZE, TETHER
from gsbridge.tasks.world import CONTROL_HZ, World

_AUXILIARY = "position."
_HEADER = 2**20
"""Allowance for names and notes in the file of the weights, bytes."""


class Policy:
    """A trained policy: maps observations to mean actions, deterministically and in full precision.

    Args:
        actor: The network.
        image_size: Edge of the picture, px.
        spec: Content of `policy.json`; empty while training.
    """

    def __init__(self, actor: Actor, image_size: int, spec: Mapping[str, Any] | None = None) -> None:
        self.actor, self.image_size, self.spec = actor, image_size, dict(spec or {})

    @torch.no_grad()
    def __call__(self, observation: Mapping[str, Array], info: Mapping[str, Any] | None = None) -> Array:
        """Return the action for an observation.

        Args:
            observation: `image`, uint8 [H, W, 3], and `proprio`, [12].
            info: Ignored; it is there so that trials can call policies and controllers alike.

        Returns:
            float32 [5], -1..1.

        Raises:
            InputError: The observation has another shape or type.
        """
        device = next(self.actor.parameters()).device
        pictures, proprio = actor_input(observation, self.image_size)
        return self.actor(pictures.to(device), proprio.to(device))[0].mode[0].cpu().numpy()


def describe(environment: PickEnvironment, settings: PolicySettings) -> dict[str, Any]:
    """Describe inputs and outputs of a policy that was trained in an environment, for `policy.json`."""
    scale, workspace = environment.target.scale, environment.workspace
    return {
        "format": FORMAT,
        "algo": settings.algo,
        "task": environment.settings.task,
        "control_hz": CONTROL_HZ,
        "observation": {
            "image": {
                "size_px": settings.image_size,
                "layout": "height, width, RGB; uint8, sRGB",
                "scale": PICTURE_SCALE,
                "offset": PICTURE_OFFSET,
                "field_of_view_rad": FIELD_OF_VIEW,
            },
            "proprio": {
                "names": PROPRIO_NAMES,
                "bound": PROPRIO_BOUND,
                "workspace_lower_m": workspace.lower,
                "workspace_upper_m": workspace.upper,
                "workspace_yaw_rad": workspace.yaw,
                "stroke_m": environment.target.stroke,
            },
        },
        "action": {
            "names": ACTION_NAMES,
            "low": -1.0,
            "high": 1.0,
            "position_m": scale.position,
            "yaw_rad": scale.yaw,
            "aperture_m": scale.aperture,
            "tether": TETHER,
        },
        "environment": asdict(environment.settings),
        "robot": _robot(environment.world),
        "onnx": {
            "inputs": {
                "image": {"type": "uint8", "shape": [1, settings.image_size, settings.image_size, 3]},
                "proprio": {"type": "float32", "shape": [1, PROPRIO]},
            },
            "outputs": {"action": {"type": "float32", "shape": [1, SIZE]}},
        },
        "network": {"channels": CHANNELS, "hidden": HIDDEN},
        "training": settings.model_dump(),
    }


def _robot(world: World) -> dict[str, Any] | None:
    """Return the poses of arm, camera and table in the training; None for a world without an arm."""
    kinematics, base_from_table = getattr(world, "kinematics", None), getattr(world, "base_from_table", None)
    if kinematics is None or base_from_table is None:
        return None
    places = kinematics.fk(kinematics.rest, ["flange", "camera", "tool"])
    return {
        "rest_posture_rad": kinematics.rest,
        "base_from_table": base_from_table,
        "flange_from_camera": np.linalg.inv(places["flange"]) @ places["camera"],
        "flange_from_tool": np.linalg.inv(places["flange"]) @ places["tool"],
        "table_from_tool_at_rest": np.linalg.inv(base_from_table) @ places["tool"],
    }


def save_policy(folder: str | Path, weights: Mapping[str, Tensor], spec: Mapping[str, Any]) -> None:
    """Write a policy, without the auxiliary head.

    Args:
        folder: Folder for `policy.safetensors` and `policy.json`.
        weights: State of an `Actor`, tensors by name. [...] each.
        spec: From `describe`, and figures of the training.
    """
    kept = {name: value.detach().cpu().contiguous() for name, value in weights.items() if not name.startswith(_AUXILIARY)}
    content = save_tensors(kept)
    with atomic_file(Path(folder) / WEIGHTS) as temporary:
        temporary.write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()
    write_json(Path(folder) / SPEC, {**spec, "sha256": digest, "versions": versions("torch")})


def load_policy(folder: str | Path) -> Policy:
    """Read a policy.

    Raises:
        InputError: A file is missing, damaged, of another format, or the two do not belong together.
    """
    folder = Path(folder)
    spec = read_json(folder / SPEC)
    actor = Actor(with_position=False)
    largest = sum(value.nbytes for value in actor.state_dict().values()) + _HEADER
    weights = regular_file(folder / WEIGHTS, "file of the weights", "Train the policy, or copy both files", largest)
    with refusing(weights, "the weights cannot be read", "Train the policy, or copy both files"):
        content = weights.read_bytes()
    if isinstance(spec.get("format"), bool) or spec.get("format") != FORMAT:
        raise InputError(folder / SPEC, f"its format is {str(spec.get('format'))[:80]}, not {FORMAT}", "Train the policy again")
    if hashlib.sha256(content).hexdigest() != spec.get("sha256"):
        raise InputError(folder / WEIGHTS, "it does not belong to policy.json", "Copy both files of one training")
    with refusing(folder, "the policy is damaged", "Train the policy again"):
        size = spec["observation"]["image"]["size_px"]
        names, entries = spec["action"]["names"], spec["observation"]["proprio"]["names"]
        actor.load_state_dict(load_tensors(content))
        broken = [name for name, value in actor.state_dict().items() if not bool(torch.isfinite(value).all())]
    if broken:
        raise InputError(folder / WEIGHTS, f"the weights of {broken[0]} are not finite", "Train the policy again")
    for listed, count in ((names, SIZE), (entries, PROPRIO)):
        if not isinstance(listed, list) or len(listed) != count:
            raise InputError(folder / SPEC, "it has other observations or actions", "Train the policy again")
    if isinstance(size, bool) or size not in IMAGE_SIZES:
        raise InputError(folder / SPEC, f"its pictures have {str(size)[:80]} px", "Train the policy again")
    actor.requires_grad_(False)
    return Policy(actor, int(size), spec)
