"""Functions and wildcard constraints shared by the rules; no rule stands here."""

import hashlib
import os
import re
import shlex
import sys
from pathlib import Path

ROOT = Path(workflow.basedir)
sys.path.insert(0, str(ROOT))
# Jobs run the code that the digests tell about, whichever copy of the package is installed.
searched = os.environ.get("PYTHONPATH", "").split(os.pathsep)
os.environ.update(
    PYTHONPATH=os.pathsep.join(filter(None, dict.fromkeys([str(ROOT), *searched])))
)

from gsbridge.configuration.checks import (
    check_asked,
    check_capture,
    check_configuration,
)
from gsbridge.digests import code_digest, kernel_digest, script_digest
from gsbridge.errors import InputError

check_configuration(config)
if workflow.is_main_process:
    # A second of imports, which jobs need not pay again.
    from gsbridge.policy.plan import check_policies

    check_policies(config, ROOT)

PRESET = config["presets"][config["preset"]]
SEED = config["seed"]
ASSET = {**config["asset"], **PRESET.get("asset", {})}
CELLS = PRESET.get("cells", config["cells"])
PAIRS = sorted({f"{cell['object']}+{cell['background']}" for cell in CELLS})
# A controller sees no picture: one background is enough for each object and task.
TRIALS = {
    f"{cell['task']}/{cell['object']}": f"{cell['task']}/{cell['object']}+{cell['background']}"
    for cell in reversed(CELLS)
}
BINDINGS = ["games", "soft", "refined", "unbound"]


def program(name):
    """Parameter: call of a program of `benchmarks/` by the interpreter that runs snakemake.

    The one on the path may belong to another environment. As a function of outputs, it is not recorded: a folder that
    was moved reruns nothing.
    """
    command = shlex.join([sys.executable, str(ROOT / f"benchmarks/{name}.py")])
    return lambda wildcards, output: command


def file_digest(path):
    """Digest of a file of the project that a rule reads or runs beside its script."""
    return hashlib.sha256((ROOT / path).read_bytes()).hexdigest()[:12]


def names(kind):
    """Names of all configured scenes of one kind."""
    return [name for name, scene in config["scenes"].items() if scene["kind"] == kind]


def one_of(choices):
    """Regular expression for one of some names; matches nothing where there are none."""
    return "|".join(sorted(choices)) or "(?!)"


def films():
    """Names of the scenes that the mirror's film studio films."""
    return [
        name for name, scene in config["scenes"].items() if "film" in scene["source"]
    ]


def preset_scenes(kind):
    """Scenes of the preset of one kind."""
    return [name for name in SCENES if config["scenes"][name]["kind"] == kind]


def settings(section):
    """Settings of one stage: the section of the config, overridden by the preset."""
    return {**config[section], **PRESET.get(section, {})}


def edited_scene():
    """Object of the figure of non-rigid edits: the configured one, or the first of the preset."""
    objects = preset_scenes("object") or names("object")
    return settings("editing")["scene"] or next(iter(objects), "none")


def capture_places(path):
    """Where a capture may lie: at its absolute path, or below the captures folder, or below the project's."""
    captures = Path(os.environ.get("GSBRIDGE_CAPTURES") or ROOT / config["captures"])
    return [(folder / Path(path).expanduser()).resolve() for folder in (captures, ROOT)]


def capture_path(path):
    """A capture's file or folder."""
    places = capture_places(path)
    return str(next((place for place in places if place.exists()), places[0]))


def asked_scenes():
    """Scenes of the preset, and those that this call's arguments name."""
    words = {word for argument in sys.argv[1:] for word in re.split(r"[/.-]", argument)}
    return sorted({*SCENES, *words.intersection(config["scenes"])})


def mirrored_scenes():
    """Scenes of the preset that the mirror films, and that therefore have a truth."""
    return [name for name in SCENES if name in films()]


def real_records():
    """Records of the real captures of the preset, which have no truth."""
    stages = {"keyframes": "capture/keyframes.json", "sfm": "sfm/sfm.json"}
    real = [name for name in SCENES if name not in films()]
    return {
        name: {key: f"results/scenes/{name}/{file}" for key, file in stages.items()}
        for name in real
    }


def scene_labels():
    """Kind and origin of each scene of the preset, for the tables."""
    origin = {name: "mirror" if name in films() else "real" for name in SCENES}
    return {
        name: {"kind": config["scenes"][name]["kind"], "origin": origin[name]}
        for name in SCENES
    }


def scenes_from(origin):
    """Scenes of the preset from the mirror or from real captures."""
    return [name for name, label in scene_labels().items() if label["origin"] == origin]


def film_records():
    """Record of each mirrored scene's film, which tells the noise of its photos."""
    return {scene: f"results/films/{scene}/film.json" for scene in mirrored_scenes()}


def comparison_figures(wildcards):
    """One comparison figure for the mirror's scenes, one for real ones, where there are any."""
    return [
        f"results/figures/rendering_comparison_{origin}.png"
        for origin in ("mirror", "real")
        if scenes_from(origin)
    ]


def compared_splats(wildcards):
    """Records of the splats that a comparison figure shows."""
    return collect(
        "results/scenes/{scene}/splats/{binding}/splats.json",
        scene=scenes_from(wildcards.origin),
        binding=["games", "soft", "refined"],
    )


def is_present(scene):
    """Whether a scene runs here: always, but for example captures whose files are not on this machine."""
    kind, value = next(iter(config["scenes"][scene]["source"].items()))
    return (
        kind == "film"
        or not config["scenes"][scene]["example"]
        or Path(capture_path(value)).exists()
    )


def scene_source(wildcards):
    """Files that a scene's keyframes are taken from."""
    kind, value = next(iter(config["scenes"][wildcards.scene]["source"].items()))
    return f"results/films/{value}/film.json" if kind == "film" else capture_path(value)


def source_path(wildcards):
    """The source as the keyframe stage takes it: a film's folder, or the capture itself."""
    kind, value = next(iter(config["scenes"][wildcards.scene]["source"].items()))
    return f"results/films/{value}" if kind == "film" else capture_path(value)


def source_kind(wildcards):
    """Kind of a scene's source: film, video, images, colmap or nerfstudio."""
    return next(iter(config["scenes"][wildcards.scene]["source"]))


def scene_camera(wildcards):
    """Calibration of the camera that took a scene, where it is shared; nothing otherwise."""
    camera = config["scenes"][wildcards.scene]["camera"]
    return f"results/cameras/{camera}.json" if camera else []


def workspace_capture(wildcards):
    """Folder of the board capture that registers the workspace; nothing where its poses are typed."""
    kind, value = next(iter(config["workspace"]["source"].items()))
    if kind == "mirror":
        return "results/workspace/capture"
    return capture_path(value) if kind == "capture" else []


def workspace_background(wildcards):
    """Asset of the table on which the board was photographed; nothing where it is none of the scenes."""
    background = config["workspace"]["background"]
    return f"results/scenes/{background}/asset/asset.json" if background else []


def workspace_light(wildcards):
    """What shows an object's shadow on the table of the work place; nothing where no object was filmed there."""
    scene, background = config["workspace"]["light"], config["workspace"]["background"]
    if scene is None or background is None:
        return {}
    # The mirror's objects stand on the mirror's table, yours on yours.
    if (
        len(
            {"film" in config["scenes"][name]["source"] for name in (scene, background)}
        )
        > 1
    ):
        return {}
    return {
        "item": f"results/scenes/{scene}/asset/asset.json",
        "views": f"results/scenes/{scene}/align/views.json",
        "images": f"results/scenes/{scene}/sfm/images",
        "masks": f"results/scenes/{scene}/masks/images",
        "background": f"results/scenes/{background}/asset/asset.json",
    }


def calibration_keyframes(wildcards):
    """Keyframes that calibrate a camera: those of its scenes in the preset, or of all its scenes if none is."""
    scenes = config["cameras"][wildcards.camera]["calibrate_from"]
    chosen = [scene for scene in scenes if scene in SCENES] or scenes
    return collect("results/scenes/{scene}/capture/keyframes.json", scene=chosen)


def scene_masks(wildcards):
    """Masks of an object; a background has none."""
    return (
        f"results/scenes/{wildcards.scene}/masks/masks.json"
        if wildcards.scene in names("object")
        else []
    )


def scene_mask_images(wildcards):
    """Folder of an object's masks; a background has none."""
    return (
        f"results/scenes/{wildcards.scene}/masks/images"
        if wildcards.scene in names("object")
        else []
    )


def bundled_scenes():
    """Scenes that become bodies for simulators: those that must have a metric scale."""
    return [name for name in SCENES if config["scenes"][name]["require_scale"]]


def splat_settings(wildcards):
    """Budget of a training: objects and backgrounds have their own."""
    return settings(f"{config['scenes'][wildcards.scene]['kind']}_splats")


def asset_settings(wildcards):
    """Settings of an asset; what an object is made of belongs to its scene."""
    return {**ASSET, "density": config["scenes"][wildcards.scene]["density"]}


def state_folder(script, item, *key):
    """Undeclared folder of a long job's checkpoint: another code, setting or seed finds another folder."""
    key = repr((script_digest(script), *key))
    return f"results/.state/{script}/{item}-{hashlib.sha256(key.encode()).hexdigest()[:12]}"


def film_settings(wildcards):
    """Size and quality of a film; the dense one, which looks like a video, has its own."""
    section = "dense_film" if wildcards.scene == "dense_pan" else "films"
    return settings(section)


def film_state(wildcards):
    """Where a film keeps its finished frames until it is whole."""
    return state_folder(
        "film_scene",
        wildcards.scene,
        film_settings(wildcards),
        SEED,
    )


def training_state(wildcards):
    """Where a training keeps its checkpoint."""
    item = "-".join(wildcards)
    return state_folder(
        "train_splats",
        item,
        splat_settings(wildcards),
        SEED,
    )


def comparison_runs(scene):
    """Names of the extra trainings of a mirrored scene: more seeds, and the same bindings on the visual hull."""
    if scene not in films():
        return []
    plan = settings("comparison")
    seeds = range(SEED, SEED + plan["seeds"])
    runs = [
        f"visual-{binding}-seed{seed}"
        for seed in seeds
        if seed != SEED
        for binding in ("games", "soft")
    ]
    if plan["hull"] and scene in names("object"):
        runs += [
            f"hull-{binding}-seed{seed}"
            for seed in seeds
            for binding in ("games", "soft")
        ]
    return runs


def comparison_surface(wildcards):
    """Mesh that a comparison run binds its splats to."""
    mesh = {"visual": "visual.ply", "hull": "collision.ply"}[wildcards.surface]
    return f"results/scenes/{wildcards.scene}/mesh/{mesh}"


def stage_records(wildcards):
    """Records of all stages of the preset's scenes, for the page that names what is degraded."""
    records = collect(
        "results/scenes/{scene}/{stage}.json",
        scene=SCENES,
        stage=["capture/keyframes", "sfm/sfm", "align/align"],
    )
    records += collect("results/scenes/{scene}/mesh/mesh.json", scene=SCENES)
    return records + collect(
        "results/scenes/{scene}/masks/masks.json", scene=preset_scenes("object")
    )


def page_records(wildcards):
    """Records of all stages that the page of tables judges: also those behind the splats."""
    assets = collect("results/scenes/{scene}/asset/asset.json", scene=bundled_scenes())
    return stage_records(wildcards) + assets


def mirrored(pairs):
    """Those of `object+background` of which the mirror films both."""
    return [pair for pair in pairs if set(pair.split("+")) <= set(films())]


def trial_records(world):
    """Records of the baseline controllers' trials in one world; the mirror has its own scenes only."""
    trials = sorted(TRIALS.values())
    return [
        f"results/trials/{trial}/{world}.json"
        for trial in trials
        if world == "sim" or mirrored([trial.split("/")[1]])
    ]


def preset_pairs():
    """Objects on backgrounds of the cells whose scenes the preset runs."""
    return [pair for pair in PAIRS if set(pair.split("+")) <= set(SCENES)]


def first_asset(kind):
    """Input function: asset of the first cell's object or background, on which the simulator as such is measured."""

    def path(wildcards):
        if not CELLS:
            raise InputError(
                "config: cells", "there is no cell to simulate", "Name at least one"
            )
        return f"results/scenes/{CELLS[0][kind]}/asset/asset.json"

    return path


def cell_task(wildcards):
    """Task of the first cell with an object on a background; a pair without a cell is grasped."""
    pair = (wildcards.object, wildcards.background)
    tasks = [
        cell["task"] for cell in CELLS if (cell["object"], cell["background"]) == pair
    ]
    return tasks[0] if tasks else "grasp"


def episode_photos(wildcards):
    """The mirror's photos of an episode, where it films both scenes."""
    pair = {wildcards.object, wildcards.background}
    folder = f"results/episodes/{wildcards.object}+{wildcards.background}/mirror"
    return {"photos": folder} if pair <= set(films()) else {}


def recordings(wildcards):
    """The rerun recordings of all stages of the preset's scenes."""
    every = collect(
        "results/rerun/{stage}/{scene}.rrd",
        stage=["capture", "sfm", "align", "mesh"],
        scene=SCENES,
    )
    every += collect("results/rerun/masks/{scene}.rrd", scene=preset_scenes("object"))
    every += collect("results/rerun/asset/{scene}.rrd", scene=bundled_scenes())
    for policy in POLICIES:
        every.append(f"results/rerun/trials/{CELL_ITEM}.rrd".format(**policy))
        every += [
            f"results/rerun/training/{POLICY_ITEM}.rrd".format(**policy, seed=seed)
            for seed in POLICY_SEEDS
        ]
    return every + collect(
        "results/rerun/splats/{scene}-{binding}.rrd",
        scene=SCENES,
        binding=["games", "soft", "refined"],
    )


def splat_records(wildcards):
    """Records of all trainings that the rendering table shows."""
    main = collect(
        "results/scenes/{scene}/splats/{binding}/splats.json",
        scene=SCENES,
        binding=BINDINGS,
    )
    extra = [
        f"results/scenes/{scene}/comparison/{run}/splats.json"
        for scene in SCENES
        for run in comparison_runs(scene)
    ]
    return main + extra


SCENES = [scene for scene in PRESET["scenes"] if is_present(scene)]
LEFT_OUT = [scene for scene in PRESET["scenes"] if scene not in SCENES]
if LEFT_OUT and workflow.is_main_process:
    logger.warning(
        f"Example captures that are not on this machine are left out: {', '.join(LEFT_OUT)}"
    )
if workflow.is_main_process:
    check_asked(sys.argv[1:], config["scenes"])
    # With results in place snakemake would go on without a missing source, and with an earlier capture's frames.
    for scene in asked_scenes():
        source = config["scenes"][scene]["source"]
        if "film" not in source:
            check_capture(scene, source, capture_places(*source.values()))

EDITED = edited_scene()


wildcard_constraints:
    scene=one_of(config["scenes"]),
    camera=one_of(config["cameras"]),
    binding=one_of(BINDINGS),
    surface="visual|hull",
    task="grasp|pick_and_place",
    seed=r"\d+",
    origin="mirror|real",
    table="grasping|renderer_contrast|pick_and_place|worlds|sight",
