"""The scenes and cells of a configured experiment, and which of them the chosen preset runs on this machine."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from gsbridge.configuration.bindings import BINDINGS
from gsbridge.configuration.checks import check_capture
from gsbridge.errors import InputError
from gsbridge.experiment.policies import PolicyFiles, workspace_of
from gsbridge.given import read_given_json
from gsbridge.reading import absent


@dataclass(frozen=True)
class Experiment:
    """A valid configuration, read for one preset.

    Args:
        config: Settings with their defaults filled in.
        root: Folder of the project.
        working: Folder in which the results lie.
    """

    config: Mapping[str, Any]
    root: Path
    working: Path

    @cached_property
    def preset(self) -> Mapping[str, Any]:
        """Content of the chosen preset: the scenes that it runs and the settings that it overrides."""
        return self.config["presets"][self.config["preset"]]

    def settings(self, section: str) -> dict[str, Any]:
        """Settings of one stage: the section of the configuration, overridden by the preset."""
        return {**self.config[section], **self.preset.get(section, {})}

    @cached_property
    def project_files(self) -> set[str]:
        """Files of the project, beside its code, that jobs read: floors, what is known of real things, models."""
        models = {variant["model"] for variant in self.config["variants"].values()} - {None}
        given = {model for model in models if not model.startswith("results/") and not Path(model).is_absolute()}
        return {"benchmarks/floors.yaml", "benchmarks/photos.json", "models/nominal.yaml", *given}

    # Scenes

    def named(self, kind: str) -> list[str]:
        """Names of all configured scenes of one kind."""
        return [name for name, scene in self.config["scenes"].items() if scene["kind"] == kind]

    @cached_property
    def films(self) -> list[str]:
        """Names of the scenes that the mirror's film studio films."""
        return [name for name, scene in self.config["scenes"].items() if "film" in scene["source"]]

    @cached_property
    def in_mirror(self) -> list[str]:
        """Names of the filmed scenes whose object or table stands in the mirror's world; further takes of an object do not."""
        return [name for name in self.films if self.config["scenes"][name].get("take") is None]

    def camera_of(self, scene: str) -> str:
        """What a scene was filmed with, for captions."""
        return "the mirror's camera" if self.source(scene)[0] == "film" else "a real camera"

    def source(self, scene: str) -> tuple[str, str]:
        """Kind of a scene's source and its value: the name of a film, or a path."""
        kind, value = next(iter(self.config["scenes"][scene]["source"].items()))
        return kind, value

    @cached_property
    def scenes(self) -> list[str]:
        """Scenes of the preset that run here: all but example captures whose files are not on this machine."""
        return [name for name in self.preset["scenes"] if self._is_present(name)]

    @property
    def left_out(self) -> list[str]:
        """Scenes of the preset that do not run here."""
        return [name for name in self.preset["scenes"] if name not in self.scenes]

    def _is_present(self, scene: str) -> bool:
        kind, value = self.source(scene)
        return (
            kind == "film" or not self.config["scenes"][scene]["example"] or (self.working / self.capture_path(value)).exists()
        )

    def scenes_of(self, kind: str) -> list[str]:
        """Scenes of one kind that run here."""
        return [name for name in self.scenes if self.config["scenes"][name]["kind"] == kind]

    @property
    def bundled(self) -> list[str]:
        """Scenes that become bodies for simulators: those that must have a metric scale."""
        return [name for name in self.scenes if self.config["scenes"][name]["require_scale"]]

    @property
    def mirrored(self) -> list[str]:
        """Scenes that run here and have a truth, because the mirror films them."""
        return [name for name in self.scenes if name in self.films]

    @property
    def labels(self) -> dict[str, dict[str, str]]:
        """Kind and origin of each scene that runs here, for the tables."""
        kinds = {name: self.config["scenes"][name]["kind"] for name in self.scenes}
        return {name: {"kind": kinds[name], "origin": "mirror" if name in self.films else "real"} for name in self.scenes}

    @property
    def real_records(self) -> dict[str, dict[str, str]]:
        """Records of the real captures that run here, which have no truth."""
        stages = {"keyframes": "capture/keyframes.json", "sfm": "sfm/sfm.json"}
        real = self.scenes_from("real")
        return {name: {key: f"results/scenes/{name}/{file}" for key, file in stages.items()} for name in real}

    def scenes_from(self, origin: str) -> list[str]:
        """Scenes that run here, from the mirror or from real captures."""
        return [name for name, label in self.labels.items() if label["origin"] == origin]

    @property
    def shapes(self) -> list[str]:
        """Scenes of the area `shapes` whose truth the mirror knows; a scene with a capture of the user's has none."""
        return [name for name in self.config["shapes"] if "film" in self.config["scenes"][name]["source"]]

    @property
    def longest_sides(self) -> dict[str, dict[str, str]]:
        """Records that tell how well an object's longest side gives the scale, by object of `shapes` and of the preset."""
        plain = [name for name in (*self.shapes, *self.mirrored) if self.config["scenes"][name].get("take") is None]
        objects = [name for name in plain if self.config["scenes"][name]["kind"] == "object"]
        return {
            name: {
                "length": f"results/scenes/{name}/align/length.json",
                "align": f"results/scenes/{name}/align/align.json",
                "score": f"results/scores/scenes/{name}.json",
                "truth": f"results/truth/{name}",
            }
            for name in objects
        }

    def vessel_trials(self, world: str) -> dict[str, dict[str, str]]:
        """Trials of the controller on `vessels` in `sim` or `mirror`, and the assets of these, by `object+background`."""
        background = self.config["workspace"]["background"]
        pairs = self.both_filmed(f"{name}+{background}" for name in self.config["vessels"])
        assets = {pair: f"results/scenes/{pair.split('+')[0]}/asset/asset.json" for pair in pairs}
        return {pair: {"trials": f"results/trials/grasp/{pair}/{world}.json", "asset": assets[pair]} for pair in pairs}

    @property
    def photos(self) -> list[str]:
        """Scenes of the area `photos` whose captures are on this machine."""
        real = [name for name in self.config["photos"] if name not in self.films]
        return [name for name in real if self._is_present(name)]

    def photo_records(self, scene: str) -> dict[str, list[str] | str]:
        """What the area `photos` reads of a scene, by name: records, photos, meshes, trainings and turned photos."""
        folder, first = f"results/scenes/{scene}", self.config["seed"]
        seeds = range(first, first + self.settings("comparison")["seeds"])
        records: dict[str, list[str] | str] = {
            "sfm": f"{folder}/sfm/sfm.json",
            "align": f"{folder}/align/align.json",
            "views": f"{folder}/align/views.json",
            "images": f"{folder}/sfm/images",
            "masks": f"{folder}/masks/masks.json",
            "mesh": f"{folder}/mesh/mesh.json",
            "visual": f"{folder}/mesh/visual.ply",
            "collision": f"{folder}/mesh/collision.ply",
        }
        for binding in ("soft", "games", "games_vertices"):
            further = [f"{folder}/comparison/visual-{binding}-seed{seed}/splats.json" for seed in seeds[1:]]
            records[binding] = [f"{folder}/splats/{binding}/splats.json", *further]
        turns = (0, 90, 180, 270) if self.may_turn(scene) else ()
        records["turned"] = [f"{folder}/turned/{degrees}.json" for degrees in turns]
        return records | {
            "refined": f"{folder}/splats/refined/splats.json",
            "recipe": f"{folder}/recipe/soft/splats.json",
        }

    def may_turn(self, scene: str) -> bool:
        """Whether a scene's photos can be turned: those that come with cameras, a direction or points would have to be, too."""
        settings = self.config["scenes"][scene]
        bound = (settings.get(key) for key in ("camera", "up", "metres_per_unit"))
        points, length = (settings.get("masks") or {}).get("points"), settings.get("known_length") or {}
        return not any([*bound, points, "object" in length]) and bool({"images", "video"} & set(settings["source"]))

    def photo_files(self, scene: str) -> list[str]:
        """All files and folders of `photo_records`."""
        return [path for kept in self.photo_records(scene).values() for path in ([kept] if isinstance(kept, str) else kept)]

    @property
    def edited(self) -> str:
        """Object of the figure of non-rigid edits: the configured one, or the first that runs here."""
        objects = self.scenes_of("object") or self.named("object")
        return self.settings("editing")["scene"] or next(iter(objects), "none")

    @property
    def stage_records(self) -> list[str]:
        """Records of all stages of the scenes that run here, for the page that names what is degraded."""
        early = [f"{scene}/{stage}" for scene in self.scenes for stage in ("capture/keyframes", "sfm/sfm", "align/align")]
        surfaces = [f"{scene}/mesh/mesh" for scene in self.scenes]
        masks = [f"{scene}/masks/masks" for scene in self.scenes_of("object")]
        return [f"results/scenes/{name}.json" for name in (*early, *surfaces, *masks)]

    @property
    def stage_recordings(self) -> list[str]:
        """Rerun recordings of all stages of the scenes that run here."""
        every = [f"{stage}/{scene}" for stage in ("capture", "sfm", "align", "mesh") for scene in self.scenes]
        every += [f"masks/{scene}" for scene in self.scenes_of("object")]
        every += [f"asset/{scene}" for scene in self.bundled]
        every += [f"splats/{scene}-{binding}" for scene in self.scenes for binding in BINDINGS[:3]]
        return [f"results/rerun/{name}.rrd" for name in every]

    def page_records(self, scene: str) -> list[str]:
        """Records that a scene's page shows, whether the preset runs it or not; with an asset if the scene becomes a body."""
        kept = self.config["scenes"][scene]
        stages = ["capture/keyframes", "sfm/sfm", "align/align", "mesh/mesh", "splats/soft/splats"]
        stages += ["masks/masks"] * (kept["kind"] == "object") + ["asset/asset"] * kept["require_scale"]
        return [f"results/scenes/{scene}/{stage}.json" for stage in stages]

    @property
    def workspace_light(self) -> dict[str, str]:
        """Files, by name, that show an object's shadow on the work place's table; empty if no object was filmed there."""
        item, background = self.config["workspace"]["light"], self.config["workspace"]["background"]
        # The mirror's objects stand on the mirror's table and the user's on the user's, so a mixed pair shares no light.
        if None in (item, background) or (item in self.films) != (background in self.films):
            return {}
        return {
            "item": f"results/scenes/{item}/asset/asset.json",
            "views": f"results/scenes/{item}/align/views.json",
            "images": f"results/scenes/{item}/sfm/images",
            "masks": f"results/scenes/{item}/masks/images",
            "background": f"results/scenes/{background}/asset/asset.json",
        }

    # Captures

    def capture_places(self, path: str) -> list[Path]:
        """Where a capture may lie: at its absolute path, or below the captures folder, or below the project's.

        Raises:
            InputError: The path names an unknown user or is too long, a link leads back to itself, or a folder may not be read.
        """
        captures = Path(os.environ.get("GSBRIDGE_CAPTURES") or self.root / self.config["captures"])
        try:
            places = [(folder / Path(path).expanduser()).resolve() for folder in (captures, self.root)]
            for place in places:
                place.exists()
        except (OSError, RuntimeError) as error:
            reason = (getattr(error, "strerror", None) or str(error))[:200].rstrip(".")
            raise InputError(self._key_of(path), f"'{path[:80]}' leads nowhere: {reason}", "Correct the path") from error
        return places

    def capture_path(self, path: str) -> str:
        """A capture's file or folder.

        Raises:
            InputError: Its path cannot be followed, or holds braces, which snakemake takes for a wildcard.
        """
        places = self.capture_places(path)
        found = self.portable(next((place for place in places if place.exists()), places[0]))
        if "{" in found or "}" in found:
            raise InputError(
                self._key_of(path), f"the path {found} holds braces, which mean a wildcard", "Rename it without them"
            )
        return found

    def _key_of(self, path: str) -> str:
        """What names a capture in the configuration: a scene's source, or else the path itself."""
        sources = {
            value: f"config: scenes.{scene}.source.{kind}"
            for scene in self.config["scenes"]
            for kind, value in [self.source(scene)]
        }
        return sources.get(path, path[:80])

    def portable(self, path: str | Path) -> str:
        """A path as it is recorded: relative inside the project or the working folder, so that both may be moved."""
        path = Path(path)
        inside = any(path.is_relative_to(folder) for folder in (self.root, self.working))
        return os.path.relpath(path, self.working) if inside else str(path)

    def scene_source(self, scene: str) -> str:
        """File or folder that a scene's keyframes are taken from.

        Raises:
            InputError: A capture is not there, or its list of photos is damaged. Without this error, snakemake would go on with
                the frames of an earlier capture if there are any.
        """
        kind, value = self.source(scene)
        if kind == "film":
            return f"results/films/{scene}/film.json"
        check_capture(scene, self.config["scenes"][scene]["source"], self.capture_places(value))
        path = self.capture_path(value)
        if kind == "nerfstudio":
            read_given_json(self.working / path, "Export it again from the program that made it, or name another file")
        return path

    def board_folder(self, path: str) -> str:
        """Folder of the photos of the board that register the workspace.

        Raises:
            InputError: The folder is not there; snakemake would only say that an input is missing.
        """
        places = self.capture_places(path)
        if not any(place.is_dir() for place in places):
            remedy = "Name the folder that holds the photos and arm.csv; see docs/registration.md"
            raise InputError("config: workspace.source.capture", absent(places), remedy)
        return self.capture_path(path)

    # Cells

    @cached_property
    def cells(self) -> list[dict[str, Any]]:
        """Cells of the preset."""
        return self.preset.get("cells", self.config["cells"])

    @property
    def pairs(self) -> list[str]:
        """Each `object+background` of the cells, once."""
        return sorted({PolicyFiles.of(cell).pair for cell in self.cells})

    @property
    def preset_pairs(self) -> list[str]:
        """The `object+background` pairs of which both scenes run with this preset."""
        return [pair for pair in self.pairs if set(pair.split("+")) <= set(self.scenes)]

    def both_filmed(self, pairs: Iterable[str]) -> list[str]:
        """The `object+background` pairs of which the mirror's world holds both scenes."""
        return [pair for pair in pairs if set(pair.split("+")) <= set(self.in_mirror)]

    def first_asset(self, kind: str) -> str:
        """Asset of the first cell's object or background, with which the simulator itself is measured.

        Raises:
            InputError: There is no cell.
        """
        if not self.cells:
            raise InputError("config: cells", "there is no cell to simulate", "Name at least one")
        return f"results/scenes/{self.cells[0][kind]}/asset/asset.json"

    def task_of(self, item: str, background: str) -> str:
        """Task of the first cell with an object on a background; `grasp` for a pair without a cell."""
        tasks = (cell["task"] for cell in self.cells if (cell["object"], cell["background"]) == (item, background))
        return next(tasks, "grasp")

    def controller_trials(self, world: str) -> list[str]:
        """Records of the baseline controllers' trials in one world; the mirror has its own scenes only.

        A controller sees no picture, so the first background is enough for each object and task.
        """
        first = {(cell["task"], cell["object"]): PolicyFiles.of(cell) for cell in reversed(self.cells)}
        chosen = sorted(f"{policy.task}/{policy.pair}" for policy in first.values())
        filmed = self.both_filmed(trial.split("/")[1] for trial in chosen)
        return [f"results/trials/{trial}/{world}.json" for trial in chosen if world == "sim" or trial.split("/")[1] in filmed]

    def severity(self, world: str) -> tuple[int, int]:
        """Severity of look and of physics of a configured world; (0, 0) for any other."""
        given = self.config["worlds"].get(world, {"severity": 0})["severity"]
        return (given["look"], given["physics"]) if isinstance(given, dict) else (given, given)

    def trial_registration(self, world: str, variant: str) -> str:
        """Registration that trials use: that of the mirror's world in which they run if it is severe, else the variant's."""
        severe = self.severity(world) != (0, 0)
        if severe and "mirror" in self.config["workspace"]["source"]:
            return f"results/workspace/worlds/{world}/registration.json"
        return workspace_of(self.config["variants"][variant])["registration"]

    # Trainings of splats

    def comparison_runs(self, scene: str) -> list[str]:
        """Names of the extra trainings of a scene: further seeds, and for a mirrored object trainings on its visual hull."""
        plan, first = self.settings("comparison"), self.config["seed"]
        seeds = range(first, first + plan["seeds"])
        runs = [f"visual-{binding}-seed{seed}" for seed in seeds[1:] for binding in ("games", "soft", "games_vertices")]
        if plan["hull"] and scene in self.named("object") and scene in self.films:
            runs += [f"hull-{binding}-seed{seed}" for seed in seeds for binding in ("games", "soft")]
        return runs

    @property
    def splat_records(self) -> list[str]:
        """Records of all trainings that the rendering table shows."""
        main = [f"results/scenes/{scene}/splats/{binding}/splats.json" for scene in self.scenes for binding in BINDINGS]
        runs = [(scene, run) for scene in self.scenes for run in self.comparison_runs(scene)]
        return main + [f"results/scenes/{scene}/comparison/{run}/splats.json" for scene, run in runs]
