"""Checks of the configuration that a JSON schema cannot express: names must point somewhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gsbridge.errors import InputError


def check_configuration(config: Mapping[str, Any]) -> None:
    """Check that every name in the configuration exists.

    Args:
        config: The configuration, already valid against its schema, with defaults filled in.

    Raises:
        InputError: A preset, scene or camera is named that is not configured.
    """
    scenes, cameras, presets = config["scenes"], config["cameras"], config["presets"]
    if config["preset"] not in presets:
        raise _unknown("config: preset", config["preset"], presets)
    for name, preset in presets.items():
        for scene in preset["scenes"]:
            if scene not in scenes:
                raise _unknown(f"config: presets.{name}.scenes", scene, scenes)
    for name, scene in scenes.items():
        if scene["camera"] is not None and scene["camera"] not in cameras:
            raise _unknown(f"config: scenes.{name}.camera", scene["camera"], cameras)
        if scene["require_scale"] and scene["board"] is None and scene["known_length"] is None:
            raise InputError(
                f"config: scenes.{name}.require_scale",
                "a metric scale is required, but the scene has neither a board nor a known length",
                "Set board: a4 or letter, give known_length in metres, or set require_scale: false",
            )
    for name, camera in cameras.items():
        for scene in camera["calibrate_from"]:
            if scene not in scenes:
                raise _unknown(f"config: cameras.{name}.calibrate_from", scene, scenes)
            if scenes[scene]["board"] is None:
                raise InputError(
                    f"config: cameras.{name}.calibrate_from",
                    f"the scene '{scene}' shows no board to calibrate from",
                    "Name scenes that were filmed with the board",
                )


def _unknown(key: str, name: str, choices: Mapping[str, Any]) -> InputError:
    """Error for a name that is not among the choices."""
    return InputError(key, f"'{name}' is not configured", f"Use one of: {', '.join(sorted(choices))}")
