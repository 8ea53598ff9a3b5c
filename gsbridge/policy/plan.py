"""Checks of the configuration of policies and worlds, before any job starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.configuration.base import checked
from gsbridge.configuration.policy import PolicySettings
from gsbridge.environment.settings import TASKS
from gsbridge.errors import InputError
from gsbridge.reality.world.world_variants import world_variant

AMENDED = "results/loop/model.yaml"
"""Simulation model that the loop amends."""

SEEN = "results/picture_gap/{world}/model.yaml"
"""Simulation model that the picture gap amends, for each world."""


def check_policies(config: Mapping[str, Any], root: str | Path) -> None:
    """Refuse settings of policies and worlds that would fail hours later.

    Args:
        config: The configuration, as `read_configuration` gives it.
        root: Folder to which the paths of models are relative.

    Raises:
        InputError: Settings of a variant contradict one another, its model does not exist, a world sets an unknown hidden
            parameter, or a list or loop names something that is not configured.
    """
    presets = {"": {}, **{f"presets.{name}.": preset for name, preset in config["presets"].items()}}
    for name, variant in config["variants"].items():
        for place, preset in presets.items():
            for task in TASKS:
                section = f"{task}_policy"
                values = {**config[section], **preset.get(section, {}), **variant["policy"]}
                checked(PolicySettings, values, f"config: variants.{name} with {place}{section}")
        made = str(variant["model"]).startswith("results/")
        if variant["model"] is not None and not made and not (Path(root) / variant["model"]).is_file():
            raise InputError(f"config: variants.{name}.model", f"{variant['model']} does not exist", "Name a YAML file")
        for key in ("registered_in", "calibrated_in"):
            if variant[key] is not None and variant[key] not in config["worlds"]:
                choices = ", ".join(sorted(config["worlds"]))
                raise InputError(f"config: variants.{name}.{key}", f"'{variant[key]}' is no world", f"Use one of: {choices}")
    for place, section in presets.items():
        for world in section.get("trials", {} if place else config["trials"]).get("worlds", []):
            if world not in config["worlds"]:
                raise InputError(
                    f"config: {place}trials.worlds",
                    f"'{world}' is not configured",
                    f"Use one of: {', '.join(sorted(config['worlds']))}",
                )
    study = config["study"]
    for place, section in (
        ("study", study),
        ("study.picture_gap", study["picture_gap"]),
        ("study.severity", study["severity"]),
    ):
        for key, kind in (("variants", "variants"), ("graded", "variants"), ("worlds", "worlds")):
            for name in section.get(key, []):
                if name not in config[kind]:
                    choices = ", ".join(sorted(config[kind]))
                    raise InputError(f"config: {place}.{key}", f"'{name}' is not configured", f"Use one of: {choices}")
    if config["study"]["picture_gap"]["amended"]:
        _check_picture_gap(config)
    if config["loop"]["variant"] != "default":  # the default stands for no demonstration at all
        _check_loop(config)
    for name, world in config["worlds"].items():
        seed = config["seed"] if world["seed"] is None else world["seed"]
        world_variant(config["seed"], seed, world["hidden"], f"config: worlds.{name}.hidden")


def _check_picture_gap(config: Mapping[str, Any]) -> None:
    """Refuse settings with which the picture gap's loop cannot run.

    Raises:
        InputError: It names something that is not configured, an amended world is the reference, or a variant learns with
            another model.
    """
    photographed, cell = config["study"]["picture_gap"], config["study"]["cell"]
    for key in ("object", "background"):
        if cell[key] not in config["scenes"]:
            choices = ", ".join(sorted(config["scenes"]))
            raise InputError(f"config: study.cell.{key}", f"'{cell[key]}' is not configured", f"Use one of: {choices}")
    for world in (photographed["reference"], *photographed["amended"]):
        if world not in config["worlds"]:
            choices = ", ".join(sorted(config["worlds"]))
            raise InputError("config: study.picture_gap", f"'{world}' is not configured", f"Use one of: {choices}")
    for world, names in photographed["controls"].items():
        if not photographed["amended"].get(world):
            raise InputError(
                f"config: study.picture_gap.controls.{world}", "no variant learns for it", "Name one under 'amended'"
            )
        _check_controls(config, f"study.picture_gap.controls.{world}", names)
    for world, variants in photographed["amended"].items():
        place = f"config: study.picture_gap.amended.{world}"
        if world == photographed["reference"]:
            raise InputError(place, "this world is the reference", "Name a world in which something changed")
        for name in variants:
            if name not in config["variants"]:
                choices = ", ".join(sorted(config["variants"]))
                raise InputError(place, f"'{name}' is not configured", f"Use one of: {choices}")
            if config["variants"][name]["model"] != SEEN.format(world=world):
                raise InputError(
                    f"config: variants.{name}.model",
                    f"it is not what photos of {world} amend",
                    f"Write model: {SEEN.format(world=world)}",
                )


def _check_controls(config: Mapping[str, Any], place: str, names: Sequence[str]) -> None:
    """Refuse controls of a loop that are not configured as variants.

    Args:
        config: The configuration.
        place: Place of the controls in the configuration, for messages.
        names: Names of the controls.

    Raises:
        InputError: A control is not configured as a variant.
    """
    for name in names:
        if name not in config["variants"]:
            choices = ", ".join(sorted(config["variants"]))
            raise InputError(f"config: {place}", f"'{name}' is not configured", f"Use one of: {choices}")


def _check_loop(config: Mapping[str, Any]) -> None:
    """Refuse settings with which the closed loop cannot run.

    Raises:
        InputError: It names something that is not configured, both of its worlds are the same, or its variant learns with
            another model.
    """
    loop = config["loop"]
    _check_controls(config, "loop.controls", loop["controls"])
    places = {
        "variant": (loop["variant"], "variants"),
        "reference": (loop["reference"], "worlds"),
        "changed": (loop["changed"], "worlds"),
        "cell.object": (loop["cell"]["object"], "scenes"),
        "cell.background": (loop["cell"]["background"], "scenes"),
    }
    for key, (name, section) in places.items():
        if name not in config[section]:
            choices = ", ".join(sorted(config[section]))
            raise InputError(f"config: loop.{key}", f"'{name}' is not configured", f"Use one of: {choices}")
    if loop["reference"] == loop["changed"]:
        raise InputError("config: loop.changed", "this world is the reference", "Name a world in which something changed")
    if config["variants"][loop["variant"]]["model"] != AMENDED:
        raise InputError(
            f"config: variants.{loop['variant']}.model", "it is not the model that the loop amends", f"Write model: {AMENDED}"
        )
