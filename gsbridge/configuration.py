"""Checks of the configuration that a JSON schema cannot express: names point somewhere, no key stands twice."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from gsbridge.errors import InputError


def check_duplicates(paths: Iterable[str | Path]) -> None:
    """Refuse a configuration file in which one key stands twice: YAML would silently keep the last one alone.

    Args:
        paths: The configuration files in use.

    Raises:
        InputError: A key stands twice in one block.
    """
    for path in paths:
        with open(path, encoding="utf-8") as file:
            try:
                root = yaml.compose(file, Loader=yaml.SafeLoader)
            except yaml.YAMLError:
                # JSON that is no YAML; whoever loads the file names other faults.
                continue
        _refuse_duplicates(root, Path(path), "")


def _refuse_duplicates(node: yaml.Node | None, path: Path, above: str) -> None:
    """Look for keys that stand twice in a block and in the blocks inside it."""
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _refuse_duplicates(item, path, above)
    if not isinstance(node, yaml.MappingNode):
        return
    lines: dict[str, int] = {}
    for key, value in node.value:
        name, line = str(key.value), key.start_mark.line + 1
        if name in lines:
            raise InputError(
                path,
                f"the key '{above}{name}' stands twice, in lines {lines[name]} and {line}; the first would be lost",
                f"Put both under one '{name}:'",
            )
        lines[name] = line
        _refuse_duplicates(value, path, f"{above}{name}.")


def check_configuration(config: Mapping[str, Any]) -> None:
    """Check what would otherwise fail hours later: names that point nowhere, settings that lack or contradict another.

    Args:
        config: The configuration, already valid against its schema, with defaults filled in.

    Raises:
        InputError: A preset, scene, camera or file is named that is not there, or a setting cannot work.
    """
    scenes, cameras, presets = config["scenes"], config["cameras"], config["presets"]
    if config["preset"] not in presets:
        raise _unknown("config: preset", config["preset"], presets)
    for name, preset in presets.items():
        for scene in preset["scenes"]:
            if scene not in scenes:
                raise _unknown(f"config: presets.{name}.scenes", scene, scenes)
    for name, scene in scenes.items():
        _check_source(name, scene)
        _check_known_length(name, scene)
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
            if scenes[scene]["board"] != camera["board"]:
                raise InputError(
                    f"config: cameras.{name}.board",
                    f"the camera is calibrated from the {camera['board']} board, "
                    f"but the scene '{scene}' shows the {scenes[scene]['board']} one",
                    "Name scenes that show the same board, and give the camera that board",
                )
    _check_weights(config)


def _check_source(name: str, scene: Mapping[str, Any]) -> None:
    """Refuse a film under another scene's name."""
    film = scene["source"].get("film", name)
    if film != name:
        raise InputError(
            f"config: scenes.{name}.source.film",
            f"the film '{film}' can only be the scene '{film}': film and truth are kept under one name",
            f"Name the scene '{film}'",
        )


def _check_known_length(name: str, scene: Mapping[str, Any]) -> None:
    """Refuse a known length of which nobody can tell where it is."""
    length = scene["known_length"]
    if length is None:
        return
    key = f"config: scenes.{name}.known_length"
    if ("object" in length) == ("between" in length):
        raise InputError(
            key,
            "what the length belongs to must be said, once",
            "Add either `object: longest` or `between: [[image, u, v], [image, u, v]]`",
        )
    if "object" in length and scene["kind"] == "background":
        raise InputError(
            key, "a background has no object to measure", "Give two points on the table: `between: [[image, u, v], ...]`"
        )


def _check_weights(config: Mapping[str, Any]) -> None:
    """Refuse weights that are not there."""
    preset = config["presets"][config["preset"]]
    masks = {**config["masks"], **preset.get("masks", {})}
    if masks["backend"] == "sam2":
        weights = masks["sam2_weights"]
        if weights is None:
            raise InputError(
                "config: masks.sam2_weights", "the backend sam2 needs weights", "Name the folder of a Sam2VideoModel"
            )
        if not (Path(weights) / "config.json").is_file():
            raise InputError(
                "config: masks.sam2_weights",
                f"the folder {weights} holds no config.json of a Sam2VideoModel",
                "Name the folder that the weights were saved into; see docs/masks.md",
            )
    for section in ("object_splats", "background_splats"):
        weights = {**config[section], **preset.get(section, {})}["lpips_weights"]
        if weights is not None and not Path(weights).is_file():
            raise InputError(
                f"config: {section}.lpips_weights", f"the file {weights} does not exist", "Correct it, or set it to null"
            )


def _unknown(key: str, name: str, choices: Mapping[str, Any]) -> InputError:
    """Error for a name that is not among the choices."""
    return InputError(key, f"'{name}' is not configured", f"Use one of: {', '.join(sorted(choices))}")
