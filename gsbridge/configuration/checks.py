"""Checks of the configuration that its models cannot express: names and paths point somewhere, settings fit together."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gsbridge.configuration.faults import near
from gsbridge.errors import InputError
from gsbridge.reading import absent

_LONGEST_NAME = 60
"""Largest length of a scene's name. Files are named after two scenes and more, and a file system takes 255 letters."""


def check_configuration(config: Mapping[str, Any]) -> None:
    """Check what would otherwise fail hours later: names that point nowhere, settings that lack or contradict another.

    Args:
        config: The configuration, as `read_configuration` gives it.

    Raises:
        InputError: A preset, scene, camera or file is named that is not there, a name is too long, or a setting cannot work.
    """
    scenes, cameras, presets = config["scenes"], config["cameras"], config["presets"]
    _check_names(scenes)
    if config["preset"] not in presets:
        raise _unknown("config: preset", config["preset"], presets)
    for name, preset in presets.items():
        for scene in preset["scenes"]:
            if scene not in scenes:
                raise _unknown(f"config: presets.{name}.scenes", scene, scenes)
    for key, cells in [
        ("cells", config.get("cells", [])),
        *((f"presets.{n}.cells", p.get("cells", [])) for n, p in presets.items()),
    ]:
        _check_cells(key, cells, scenes)
    _check_workspace(config.get("workspace", {}), scenes)
    _check_edited("editing", config.get("editing", {}), scenes)
    for name, preset in presets.items():
        _check_edited(f"presets.{name}.editing", preset.get("editing", {}), scenes)
    for name, scene in scenes.items():
        _check_source(name, scene)
        _check_camera(name, scene, scenes, cameras)
        _check_known_length(name, scene)
        if scene.get("metres_per_unit") is not None and not {"colmap", "nerfstudio"} & scene["source"].keys():
            raise InputError(
                f"config: scenes.{name}.metres_per_unit",
                "only poses that come with the photos have a unit",
                "Remove it, or give the photos with their poses: source: {nerfstudio: FILE} or {colmap: FOLDER}",
            )
        lengths = (scene["board"], scene["known_length"], scene.get("metres_per_unit"))
        if scene["require_scale"] and all(item is None for item in lengths):
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
    for key in ("shapes", "vessels", "photos"):
        _check_scored(key, config.get(key, []), scenes)
    _check_weights(config)


def _check_names(scenes: Iterable[str]) -> None:
    """Refuse names of scenes of which no file can be named."""
    for name in scenes:
        if len(name) > _LONGEST_NAME:
            problem = f"the name has {len(name)} letters, and {_LONGEST_NAME} are the most: files are named after it"
            raise InputError(f"config: scenes.{name[:_LONGEST_NAME]}...", problem, "Shorten it")
        if re.search(r"(.+)\1{19}$", name):
            # Snakemake takes it for the result of a rule that feeds itself.
            raise InputError(f"config: scenes.{name}", "the name ends in twenty times the same letters", "Rename it")


def _check_cells(key: str, cells: Sequence[Mapping[str, str]], scenes: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse cells of scenes that are not there, of the wrong kind, or named twice."""
    for number, cell in enumerate(cells):
        for kind in ("object", "background"):
            place, scene = f"config: {key}[{number}].{kind}", cell[kind]
            if scene not in scenes:
                raise _unknown(place, scene, {name: None for name, other in scenes.items() if other["kind"] == kind})
            if scenes[scene]["kind"] != kind:
                raise InputError(place, f"'{scene}' is of the kind {scenes[scene]['kind']}", f"Name a scene of the kind {kind}")
        if cell in cells[:number]:
            raise InputError(f"config: {key}[{number}]", "the cell stands twice", "Remove one")


def _check_workspace(workspace: Mapping[str, Any], scenes: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse a table that is no background, whose size would not be known, or that is not where the arm's photos were taken."""
    background, lit = workspace.get("background"), workspace.get("light")
    if lit is not None:
        _check_light(lit, scenes)
    if background is None:
        return
    place = "config: workspace.background"
    if scenes.get(background, {}).get("kind") != "background":
        raise _unknown(place, background, {name: None for name, scene in scenes.items() if scene["kind"] == "background"})
    if not scenes[background]["require_scale"]:
        raise InputError(place, f"'{background}' may end without a scale", f"Set scenes.{background}.require_scale: true")
    source = workspace.get("source", {"mirror": True})
    photographed, filmed = "mirror" in source, "film" in scenes[background]["source"]
    if "typed" not in source and photographed != filmed:
        whose = ("the mirror's arm", "a table of yours") if photographed else ("your arm", "the mirror's table")
        raise InputError(place, f"{whose[0]} cannot see {whose[1]}", "Name the table under the board, or null")


def _check_light(lit: str, scenes: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse what throws no shadow on a table."""
    if scenes.get(lit, {}).get("kind") != "object":
        objects = {name: None for name, scene in scenes.items() if scene["kind"] == "object"}
        raise _unknown("config: workspace.light", lit, objects)


def _check_edited(key: str, editing: Mapping[str, Any], scenes: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse an edited scene that is not there or is no object."""
    scene = editing.get("scene")
    if scene is None:
        return
    objects = {name: None for name, other in scenes.items() if other["kind"] == "object"}
    if scene not in scenes:
        raise _unknown(f"config: {key}.scene", scene, objects)
    if scene not in objects:
        raise InputError(f"config: {key}.scene", f"'{scene}' is a background", "Name a scene of the kind object")


def _check_source(name: str, scene: Mapping[str, Any]) -> None:
    """Refuse a film under another scene's name, and a take of what the mirror does not film or walk round."""
    film, take = scene["source"].get("film"), scene.get("take")
    if take is not None and (film is None or scene["kind"] != "object"):
        raise InputError(f"config: scenes.{name}.take", "only the mirror's films of objects have takes", "Remove it")
    called = film if take is None else f"{film}_{take}"
    if film is not None and called != name:
        raise InputError(
            f"config: scenes.{name}.source.film",
            f"the film '{film}' can only be the scene '{called}': film and truth are kept under one name",
            f"Name the scene '{called}'",
        )


def _check_scored(key: str, scored: Sequence[str], scenes: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse to score objects that are not there; those whose source does not fit the key are left out later."""
    known = {name: None for name, scene in scenes.items() if scene["kind"] == "object"}
    for name in scored:
        if name not in known:
            raise _unknown(f"config: {key}", name, known)


def _check_camera(
    name: str, scene: Mapping[str, Any], scenes: Mapping[str, Mapping[str, Any]], cameras: Mapping[str, Mapping[str, Any]]
) -> None:
    """Refuse a shared camera that is not there, that cannot have taken the scene, or where the photos have their own."""
    camera = scene["camera"]
    if camera is None:
        return
    if camera not in cameras:
        raise _unknown(f"config: scenes.{name}.camera", camera, cameras)
    if {"colmap", "nerfstudio"} & scene["source"].keys():
        raise InputError(
            f"config: scenes.{name}.camera",
            f"the photos come with cameras of their own, so '{camera}' would not be used",
            "Remove it, or give the photos alone: source: {images: FOLDER}",
        )
    filmed = {("film" in scenes[other]["source"]) for other in cameras[camera]["calibrate_from"] if other in scenes}
    if filmed == {"film" not in scene["source"]}:
        mirror, real = "the mirror's virtual camera", "a real camera"
        took, cannot = (mirror, "a real capture") if True in filmed else (real, "a film of the mirror")
        raise InputError(
            f"config: scenes.{name}.camera",
            f"'{camera}' is {took}, which cannot have taken {cannot}",
            "Leave the camera out (it is calibrated from the capture), or name one that is calibrated from your captures",
        )


def check_asked(arguments: Iterable[str], scenes: Iterable[str]) -> None:
    """Refuse results of a scene that is not configured; snakemake would only say that no rule makes them.

    Args:
        arguments: Arguments of the command line.
        scenes: Names of the configured scenes.

    Raises:
        InputError: A result of another scene is asked for.
    """
    for argument in arguments:
        found = re.match(r"(?:\./)?results/(?:scenes|films)/([^/]+)/", argument)
        if found and found[1] not in scenes:
            known = sorted(scenes)
            remedy = f"{near(found[1], known)}Scenes of the config: {', '.join(known)}"
            raise InputError(argument, f"'{found[1]}' is no scene", remedy)


_FORM = {"video": "file", "images": "folder", "colmap": "folder", "nerfstudio": "file"}


def check_capture(name: str, source: Mapping[str, str], places: Sequence[str | Path]) -> None:
    """Check that the files of a scene are there, before anything goes on with what an earlier file left behind.

    Args:
        name: The scene.
        source: Kind and path of its source, as in the configuration.
        places: Where it is looked for, in this order.

    Raises:
        InputError: Nothing is there, or a folder stands where a file is wanted, or the other way round.
    """
    kind = next(iter(source))
    key = f"config: scenes.{name}.source.{kind}"
    found = next((Path(place) for place in places if Path(place).exists()), None)
    if found is None:
        raise InputError(key, absent(places), "Correct the path, or put the capture there")
    if _FORM[kind] == "file" and found.is_dir():
        remedy = (
            "Name the file inside it" if kind == "nerfstudio" else "Name the video, or write images: for a folder of photos"
        )
        raise InputError(key, f"{found} is a folder, a file is wanted", remedy)
    if _FORM[kind] == "folder" and not found.is_dir():
        remedy = "Name the folder that holds it" + (", or write video: for a film" if kind == "images" else "")
        raise InputError(key, f"{found} is a file, a folder is wanted", remedy)


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
    return InputError(key, f"'{name}' is not configured", f"{near(name, choices)}Use one of: {', '.join(sorted(choices))}")
