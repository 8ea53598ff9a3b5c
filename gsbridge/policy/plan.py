"""What the configuration says of policies, checked before any job starts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsbridge.environment.settings import TASKS
from gsbridge.errors import InputError
from gsbridge.policy.settings import PolicySettings
from gsbridge.reality.world.further import further_world


def check_policies(config: Mapping[str, Any], root: str | Path) -> None:
    """Refuse settings of policies and worlds that would fail hours later.

    Args:
        config: The configuration, valid against its schema, with defaults filled in.
        root: Folder that models are named from.

    Raises:
        InputError: Settings of a variant contradict one another, its model does not exist, a world sets a hidden parameter
            that there is not, or the loop names what is not configured.
    """
    presets = {"": {}, **{f"presets.{name}.": preset for name, preset in config["presets"].items()}}
    for name, variant in config["variants"].items():
        for place, preset in presets.items():
            for task in TASKS:
                section = f"{task}_policy"
                try:
                    PolicySettings(**{**config[section], **preset.get(section, {}), **variant["policy"]})
                except InputError as error:
                    where = f"config: variants.{name} with {place}{section}"
                    raise InputError(where, f"{error.source}: {error.problem}", error.remedy) from error
        made = str(variant["model"]).startswith("results/")
        if variant["model"] is not None and not made and not (Path(root) / variant["model"]).is_file():
            raise InputError(f"config: variants.{name}.model", f"{variant['model']} does not exist", "Name a YAML file")
    for place, section in presets.items():
        for world in section.get("trials", {} if place else config["trials"]).get("worlds", []):
            if world not in config["worlds"]:
                raise InputError(
                    f"config: {place}trials.worlds",
                    f"'{world}' is not configured",
                    f"Use one of: {', '.join(sorted(config['worlds']))}",
                )
    for variant in config["study"]["variants"]:
        if variant not in config["variants"]:
            choices = ", ".join(sorted(config["variants"]))
            raise InputError("config: study.variants", f"'{variant}' is not configured", f"Use one of: {choices}")
    loop = config["loop"]
    for key, section in (("variant", "variants"), ("reference", "worlds"), ("changed", "worlds")):
        # The defaults stand for no demonstration at all.
        if loop["variant"] != "default" and loop[key] not in config[section]:
            choices = ", ".join(sorted(config[section]))
            raise InputError(f"config: loop.{key}", f"'{loop[key]}' is not configured", f"Use one of: {choices}")
    for name, world in config["worlds"].items():
        seed = config["seed"] if world["seed"] is None else world["seed"]
        further_world(config["seed"], seed, world["hidden"], f"config: worlds.{name}.hidden")
