"""Functions and wildcard constraints shared by the rules; no rule stands here."""

import hashlib
import os
import re
import sys
from pathlib import Path

ROOT = Path(workflow.basedir)
sys.path.insert(0, str(ROOT))

from gsbridge.configuration import (
    check_asked,
    check_capture,
    check_configuration,
)
from gsbridge.digests import code_digest, kernel_digest, package_digest
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
# What a policy is named after in logs; its path has slashes instead.
POLICY_ITEM = "{task}-{object}+{background}-{renderer}-{variant}-seed{seed}"
# The same for all seeds together.
CELL_ITEM = "{task}-{object}+{background}-{renderer}-{variant}"
BINDINGS = ["games", "soft", "refined", "unbound"]


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


def state_folder(rule, item, *key):
    """Undeclared folder of a long job's checkpoint: another code, setting or seed finds another folder."""
    digest = hashlib.sha256(repr(key).encode()).hexdigest()[:12]
    return f"results/.state/{rule}/{item}-{digest}"


def film_settings(wildcards):
    """Size and quality of a film; the dense one, which looks like a video, has its own."""
    section = "dense_film" if wildcards.scene == "dense_pan" else "films"
    return settings(section)


def film_state(wildcards):
    """Where a film keeps its finished frames until it is whole."""
    return state_folder(
        "film_scene",
        wildcards.scene,
        package_digest("gsbridge.reality.mirror"),
        film_settings(wildcards),
        SEED,
    )


def training_state(wildcards):
    """Where a training keeps its checkpoint."""
    item = "-".join(wildcards)
    return state_folder(
        "train_splats",
        item,
        code_digest("gsbridge.splats.stage"),
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


def policy_file(name):
    """A file of a trained policy."""
    return (
        "results/policies/{task}/{object}+{background}/{renderer}/{variant}/seed{seed}/"
        + name
    )


def trial_file(world, suffix):
    """A file about the trials of a policy in one world."""
    place = "results/trials/{task}/{object}+{background}/{renderer}/{variant}"
    return f"{place}/{world}/seed{{seed}}.{suffix}"


def simulated_scene(wildcards):
    """All that a simulated world with a camera is made of."""
    item = f"results/scenes/{wildcards.object}"
    model = variant_of(wildcards)["model"] or "models/nominal.yaml"
    return {
        "robot": "results/robot/description",
        "robot_splats": "results/robot/splats",
        "registration": "results/workspace/registration.json",
        "photometry": "results/workspace/photometry.json",
        "item": f"{item}/asset/asset.json",
        "background": f"results/scenes/{wildcards.background}/asset/asset.json",
        "model": str(ROOT / model),
        "views": f"{item}/align/views.json",
        "images": f"{item}/sfm/images",
        "masks": f"{item}/masks/images",
        "kernels": ancient("results/.state/compile_kernels.done"),
    }


def variant_of(wildcards):
    """What a variant changes of the paper's way."""
    return config["variants"][wildcards.variant]


def policy_settings(wildcards):
    """How a policy learns: the settings of its task, those of the preset, and those of its variant."""
    return {
        **settings(f"{wildcards.task}_policy"),
        **variant_of(wildcards)["policy"],
    }


def policy_state(wildcards):
    """Where a training keeps its checkpoint."""
    return state_folder(
        "train_policy",
        "-".join(wildcards),
        code_digest("gsbridge.policy.stage"),
        policy_settings(wildcards),
        variant_of(wildcards),
    )


def world_settings(wildcards):
    """Seed of a world of the mirror, the configuration's unless it names one, and its hidden changes."""
    world = config["worlds"][wildcards.world]
    return {
        "seed": SEED if world["seed"] is None else world["seed"],
        "hidden": world["hidden"],
    }


def trial_state(world, wildcards, input):
    """Where finished trials are kept until all are done. Another policy, which is another file, finds another folder."""
    made = [Path(path).stat().st_mtime_ns for path in (input.weights, input.item)]
    item = "-".join([*wildcards, *([] if "world" in wildcards.keys() else [world])])
    code = code_digest("gsbridge.policy.trials")
    return state_folder("try_policy", item, code, settings("trials"), made, SEED)


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


def pictured_worlds(cell):
    """Worlds that pictures of trials show side by side: simulation, and the first mirror where it films both scenes."""
    pair = f"{cell['object']}+{cell['background']}"
    others = settings("trials")["worlds"] if mirrored([pair]) else []
    return ["sim", *others[:1]]


def pictured_trials(cell):
    """World and seed of the trials that pictures of a cell show, in the order of their files."""
    return [(world, seed) for seed in POLICY_SEEDS for world in pictured_worlds(cell)]


def pictured_files(cell, suffix):
    """Tables or logs of those trials."""
    return [
        trial_file(world, suffix).format(**cell, seed=seed)
        for world, seed in pictured_trials(cell)
    ]


def shown_trials(suffix):
    """Input function: the same, of the cell that wildcards name."""
    return lambda wildcards: pictured_files(dict(wildcards.items()), suffix)


def shown_worlds(wildcards):
    """World of each of those files."""
    return [world for world, _ in pictured_trials(dict(wildcards.items()))]


def shown_seeds(wildcards):
    """Seed of each of those files."""
    return [seed for _, seed in pictured_trials(dict(wildcards.items()))]


def behaviour_trials():
    """Cell, world and seed of each file of trials that behaviour is compared in: those of cells with a second world."""
    return [
        (cell, world, seed)
        for cell in POLICIES
        if len(pictured_worlds(cell)) > 1
        for world, seed in pictured_trials(cell)
    ]


def behaviour_files(suffix):
    """Tables or logs of those trials."""
    return [
        trial_file(world, suffix).format(**cell, seed=seed)
        for cell, world, seed in behaviour_trials()
    ]


def trial_films():
    """Films of trials on the page of tables: file by title."""
    trained = {"gs": "", "mesh": ", RL-sim", "mesh_vertex": ", RL-sim (vertex colours)"}
    return {
        f"{cell['task'].replace('_', ' ').capitalize()}: "
        f"{cell['object']} on {cell['background']}".replace("_", " ")
        + trained[cell["renderer"]]: f"results/films_of_trials/{CELL_ITEM}.webp".format(
            **cell
        )
        for cell in POLICIES
    }


def trial_pictures(wildcards):
    """All pictures of trials: films, recordings, and the figure where there is a second world."""
    out = list(trial_films().values())
    out += [f"results/rerun/trials/{CELL_ITEM}.rrd".format(**c) for c in POLICIES]
    if behaviour_trials():
        out.append("results/figures/behaviour_consistency.png")
    return out


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


def policy_place(policy):
    """Folder of a policy's cell below `policies/` or `trials/`."""
    pair = f"{policy['object']}+{policy['background']}"
    return f"{policy['task']}/{pair}/{policy['renderer']}/{policy['variant']}"


def policies_of(table):
    """Policies that a table of successes shows; those trained on a mesh stand beside the splats of the same cell."""
    task = "pick_and_place" if table == "pick_and_place" else "grasp"
    chosen = [policy for policy in POLICIES if policy["task"] == task]
    if table != "renderer_contrast":
        return [policy for policy in chosen if policy["renderer"] == "gs"]
    pairs = {
        (policy["object"], policy["background"])
        for policy in chosen
        if policy["renderer"] != "gs"
    }
    return [
        policy for policy in chosen if (policy["object"], policy["background"]) in pairs
    ]


def policy_files(policies, name):
    """One file of each policy and seed, below `policies/`."""
    return [
        f"results/policies/{policy_place(policy)}/seed{seed}/{name}"
        for policy in policies
        for seed in POLICY_SEEDS
    ]


def policy_trials(policies, ending):
    """Trials of policies in all worlds; the mirrors have their own scenes only."""
    return [
        f"results/trials/{policy_place(policy)}/{world}/seed{seed}.{ending}"
        for policy in policies
        for world in WORLDS
        if world == "sim" or {policy["object"], policy["background"]} <= set(films())
        for seed in POLICY_SEEDS
    ]


def robot_trials(policies):
    """A user's own trials on a robot by the place of their policy: CSV files."""
    places = map(policy_place, policies)
    return {
        place: capture_path(ROBOT_TRIALS[place])
        for place in places
        if place in ROBOT_TRIALS
    }


def table_trials(wildcards):
    """Trials that a table of successes is made of."""
    return policy_trials(policies_of(wildcards.table), "csv")


def table_trial_records(wildcards):
    """Records of the same trials."""
    return policy_trials(policies_of(wildcards.table), "json")


def table_robot_trials(wildcards):
    """A user's own trials that stand in a table of successes, by the place of their policy."""
    return robot_trials(policies_of(wildcards.table))


def table_robot_files(wildcards):
    """Files of the same."""
    return list(table_robot_trials(wildcards).values())


def table_policies(wildcards):
    """Records of the policies in a table of successes."""
    return policy_files(policies_of(wildcards.table), "training.json")


def table_records(wildcards):
    """Records of the stages that made the scenes of a table of successes."""
    scenes = {
        policy[kind]
        for policy in policies_of(wildcards.table)
        for kind in ("object", "background")
    }
    stages = ["capture/keyframes", "sfm/sfm", "align/align", "mesh/mesh", "asset/asset"]
    records = collect(
        "results/scenes/{scene}/{stage}.json", scene=sorted(scenes), stage=stages
    )
    return records + collect(
        "results/scenes/{scene}/masks/masks.json",
        scene=sorted(scenes.intersection(names("object"))),
    )


def success_tables():
    """Names of the tables of successes that the preset's policies fill."""
    names = ["grasping", "renderer_contrast", "pick_and_place"]
    return [table for table in names if policies_of(table)]


def policy_rows(wildcards):
    """Rows about policies, where the preset trains any."""
    names = [*success_tables(), "failures", "training"] if POLICIES else []
    return collect("results/rows/{name}.csv", name=names)


def policy_figures(wildcards):
    """Figures about policies, where the preset trains any."""
    names = ["success_rates", "learning_curves"] if POLICIES else []
    names += ["behaviour_consistency"] if behaviour_trials() else []
    return collect("results/figures/{name}.png", name=names)


def study_files(folder, ending):
    """Trainings, or trials in simulation, of every variant and seed of the study."""
    plan = config["study"]
    policies = [
        {**plan["cell"], "renderer": "gs", "variant": name} for name in plan["variants"]
    ]
    seeds = range(SEED, SEED + plan["seeds"])
    if folder == "trials":
        return [
            trial_file("sim", ending).format(**policy, seed=seed)
            for policy in policies
            for seed in seeds
        ]
    return [
        policy_file(ending).format(**policy, seed=seed)
        for policy in policies
        for seed in seeds
    ]


def measured_rows(name):
    """Input function: rows about policies that a score is made of; nothing where the preset trains none."""

    def path(wildcards):
        found = [file for file in policy_rows(wildcards) if Path(file).stem == name]
        return found[0] if found else []

    return path


def toy_rows(wildcards):
    """Rows of a toy run, where there was one."""
    rows = ROOT / "toy/results/rows/grasping.csv"
    return str(rows) if rows.is_file() else []


def wall_times(wildcards):
    """Wall times of whole runs, where they were measured."""
    times = "results/benchmarks/wall_times.json"
    return times if Path(times).is_file() else []


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

# Policies and their trials: which there are, and where. -------------------------------------------------------------------
WORLDS = ["sim", *settings("trials")["worlds"]]
POLICY_SEEDS = list(range(SEED, SEED + settings("trials")["policies"]))
POLICIES = [
    {
        "task": cell["task"],
        "object": cell["object"],
        "background": cell["background"],
        "renderer": cell["renderer"],
        "variant": "default",
    }
    for cell in CELLS
    if {cell["object"], cell["background"]} <= set(SCENES)
]
ROBOT_TRIALS = {
    f"{cell['task']}/{cell['object']}+{cell['background']}/{cell['renderer']}/default": cell[
        "robot_trials"
    ]
    for cell in CELLS
    if cell["robot_trials"]
}
# --------------------------------------------------------------------------------------------------------------------------

EDITED = edited_scene()


wildcard_constraints:
    scene=one_of(config["scenes"]),
    camera=one_of(config["cameras"]),
    binding=one_of(BINDINGS),
    surface="visual|hull",
    task="grasp|pick_and_place",
    seed=r"\d+",
    origin="mirror|real",
    table="grasping|renderer_contrast|pick_and_place",
