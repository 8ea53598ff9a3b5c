"""What rules look up: settings, scenes, policies, trials and cases, by wildcards; no rule stands here. See gsbridge/experiment."""

import hashlib
import os
import shlex
import sys
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(ROOT))
# Jobs run the code that the digests tell about, whichever copy of the package is installed.
searched = [str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
os.environ.update(PYTHONPATH=os.pathsep.join(filter(None, dict.fromkeys(searched))))

from gsbridge.configuration.bindings import BINDINGS
from gsbridge.configuration.checks import check_asked, check_configuration
from gsbridge.configuration.renderers import RENDERERS, SHADED
from gsbridge.digests import code_digest, kernel_digest, script_digest
from gsbridge.experiment.evidence import EvidencePlan
from gsbridge.experiment.gap_benchmark import BenchmarkPlan
from gsbridge.experiment.given_files import GivenFiles
from gsbridge.experiment.loops import JointLoop, PictureLoop, closed_loops
from gsbridge.experiment.plan import Experiment
from gsbridge.experiment.policies import ANY, policy_files, workspace_of
from gsbridge.experiment.policies import training_memory, training_minutes
from gsbridge.experiment.provenance import provenance, provenances
from gsbridge.experiment.result_dates import restore_dates
from gsbridge.experiment.severity_study import SeverityStudy
from gsbridge.experiment.tables import Tables
from gsbridge.experiment.threads import scene_threads
from gsbridge.gap.formats.files import (
    case_files,
    case_model,
    case_name,
    case_path,
    check_asked_cases,
    check_contents,
    check_own_cases,
)
from gsbridge.gap.formats.present import check_named, check_own_file
from gsbridge.workflow_faults import told

with told():
    check_configuration(config)

SEED = config["seed"]
PLAN = Experiment(config, ROOT, Path.cwd())
GIVEN = GivenFiles(PLAN)
TABLES = Tables(PLAN)
LOOP = JointLoop(PLAN)
PICTURE_GAP = PictureLoop(PLAN)
SEVERITY = SeverityStudy(PLAN)
GAP = PLAN.settings("gap")
settings = PLAN.settings
OBJECTS, BACKGROUNDS = PLAN.named("object"), PLAN.named("background")
FILMED, IN_MIRROR = set(PLAN.films), set(PLAN.in_mirror)
EDITED = PLAN.edited
# What a policy is named after in logs; its path has slashes instead.
POLICY_ITEM = f"{ANY.item}-seed{{seed}}"
# Of jobs that use all there are. Snakemake cuts it to the cores of the machine; a cluster is asked for as many, whatever the
# machine has on which the run was started.
MANY_THREADS = 8
# A case of one's own needs no entry: `--config gap_case=FILE`.
OWN_CASE = config["gap_case"]
with told():
    OWN_NAME = case_name(OWN_CASE) if OWN_CASE else ""
GAP_CASES = {**GAP["cases"], **({OWN_NAME: OWN_CASE} if OWN_CASE else {})}
CASE_PLACES = [Path.cwd(), ROOT]
GAP_BANK = "results/.state/gap_bank"
BENCHMARK = BenchmarkPlan(PLAN)
EVIDENCE = EvidencePlan(PLAN)
with told():
    SEAL = BENCHMARK.seal
    SCENE_THREADS = scene_threads()
# Another workflow that includes this one, or files in a store, have targets that are not all known here.
OWN_TARGETS = (
    Path(workflow.main_snakefile) in (ROOT / "Snakefile", ROOT / "workflow/Snakefile")
    and workflow.storage_settings.default_storage_provider is None
)

if workflow.is_main_process:
    # A second of imports, which jobs need not pay again.
    from gsbridge.policy.plan import check_policies

    with told():
        check_policies(config, ROOT)
        check_asked(sys.argv[1:], config["scenes"])
        check_asked_cases(sys.argv[1:], [*GAP_CASES, *LOOP.cases])
        check_own_cases(GAP_CASES, LOOP.cases)
        check_own_file(OWN_CASE, CASE_PLACES)
        check_contents(GAP["contents"], config["scenes"])
        for scene in PLAN.scenes:
            PLAN.scene_source(scene)
    restore_dates(Path.cwd())
    if PLAN.left_out:
        absent = ", ".join(PLAN.left_out)
        logger.warning(
            f"Example captures that are not on this machine are left out: {absent}"
        )


def one_of(choices):
    """Regular expression for one of some names; matches nothing where there are none."""
    return "|".join(sorted(choices)) or "(?!)"


def program(name):
    """Parameter: call of a program of `benchmarks/` by the interpreter that runs snakemake.

    The one on the path may belong to another environment. As a function of outputs, it is not recorded: a folder that
    was moved reruns nothing.
    """
    command = shlex.join([sys.executable, str(ROOT / f"benchmarks/{name}.py")])
    return lambda wildcards, output: command


def project_file(path):
    """A file of the project as jobs read it: a copy among the results, whose path is the same wherever the project lies."""
    return f"results/project/{path}"


def state_folder(script, wildcards, *key):
    """Undeclared folder of a long job's checkpoint: another code, setting or seed finds another folder."""
    key = hashlib.sha256(repr((script_digest(script), *key)).encode()).hexdigest()
    return f"results/.state/{script}/{'-'.join(wildcards)}-{key[:12]}"


# Scenes


@told()
def scene_source(wildcards):
    """Files that a scene's keyframes are taken from; a folder's date changes with every copy, its contents decide."""
    path = PLAN.scene_source(wildcards.scene)
    if path.startswith("results/"):
        return path
    # A capture stays where it lies, wherever the results go.
    return local(ancient(path) if Path(path).is_dir() else path)


def film_frames(wildcards):
    """Frames of the film that a scene's keyframes are taken from; nothing where they are taken from a capture."""
    filmed = PLAN.source(wildcards.scene)[0] == "film"
    return f"results/films/{wildcards.scene}/frames" if filmed else []


def scene_camera(wildcards):
    """Calibration of the camera that took a scene, where it is shared; nothing otherwise."""
    camera = config["scenes"][wildcards.scene]["camera"]
    return f"results/cameras/{camera}.json" if camera else []


def measured_length(wildcards):
    """The longest side of a scene's object, where that is the length that gives the scale; nothing otherwise."""
    length = config["scenes"][wildcards.scene]["known_length"] or {}
    file = f"results/scenes/{wildcards.scene}/align/length.json"
    return file if "object" in length else []


def calibration_keyframes(wildcards):
    """Keyframes that calibrate a camera: those of its scenes in the preset, or of all its scenes if none is."""
    scenes = config["cameras"][wildcards.camera]["calibrate_from"]
    chosen = [scene for scene in scenes if scene in PLAN.scenes] or scenes
    return collect("results/scenes/{scene}/capture/keyframes.json", scene=chosen)


def scene_masks(wildcards):
    """Masks of an object; a background has none."""
    masks = f"results/scenes/{wildcards.scene}/masks/masks.json"
    return masks if wildcards.scene in OBJECTS else []


def scene_mask_images(wildcards):
    """Folder of an object's masks; a background has none."""
    images = f"results/scenes/{wildcards.scene}/masks/images"
    return images if wildcards.scene in OBJECTS else []


def scene_records(wildcards):
    """Records of all stages of a scene, as far as its page shows them."""
    return PLAN.page_records(wildcards.scene)


@told()
def workspace_capture(wildcards):
    """Folder of the board capture that registers the workspace; nothing where its poses are typed."""
    kind, value = next(iter(config["workspace"]["source"].items()))
    if kind == "mirror":
        return "results/workspace/capture"
    if kind == "capture" and workflow.is_main_process:
        from gsbridge.registration.asked import check_board_capture

        check_board_capture(PLAN.board_folder(value))
    return PLAN.board_folder(value) if kind == "capture" else []


def workspace_background(wildcards):
    """Asset of the table on which the board was photographed; nothing where it is none of the scenes."""
    background = config["workspace"]["background"]
    return f"results/scenes/{background}/asset/asset.json" if background else []


def film_settings(wildcards):
    """Size and quality of a film; the dense one, which looks like a video, has its own."""
    return settings("dense_film" if wildcards.scene == "dense_pan" else "films")


def film_state(wildcards):
    """Where a film keeps its finished frames until it is whole."""
    take = config["scenes"][wildcards.scene]["take"]
    return state_folder("film_scene", wildcards, film_settings(wildcards), SEED, take)


def splat_settings(wildcards):
    """Budget of a training: objects and backgrounds have their own."""
    return settings(f"{config['scenes'][wildcards.scene]['kind']}_splats")


def splat_gpus(wildcards):
    """GPUs of a training of splats."""
    return int(splat_settings(wildcards)["backend"] == "cuda")


def training_state(wildcards):
    """Where a training keeps its checkpoint."""
    return state_folder("train_splats", wildcards, splat_settings(wildcards), SEED)


def comparison_surface(wildcards):
    """Mesh that a comparison run binds its splats to."""
    mesh = {"visual": "visual.ply", "hull": "collision.ply"}[wildcards.surface]
    return f"results/scenes/{wildcards.scene}/mesh/{mesh}"


def asset_settings(wildcards):
    """Settings of an asset; what an object is made of belongs to its scene."""
    density = config["scenes"][wildcards.scene]["density"]
    return {**settings("asset"), "density": density}


def episode_photos(wildcards):
    """The mirror's photos of an episode, where it films both scenes."""
    pair = f"{wildcards.object}+{wildcards.background}"
    filmed = PLAN.both_filmed([pair])
    return {"photos": f"results/episodes/{pair}/mirror"} if filmed else {}


# Policies and trials


def simulated_world(item, background, model=None):
    """All that a simulated world without shadows is made of."""
    model = model or "models/nominal.yaml"
    return {
        "robot": "results/robot/description",
        "robot_splats": "results/robot/splats",
        "registration": "results/workspace/registration.json",
        "photometry": "results/workspace/photometry.json",
        "item": f"results/scenes/{item}/asset/asset.json",
        "background": f"results/scenes/{background}/asset/asset.json",
        "model": project_file(model) if model in PLAN.project_files else model,
        "kernels": ancient("results/.state/compile_kernels.done"),
    }


def simulated_scene(wildcards):
    """All that a simulated world with a camera is made of."""
    item, light = f"results/scenes/{wildcards.object}", {}
    # RL-sim's meshes have no shadows, and need not learn anew where the light was calibrated anew.
    if wildcards.renderer in SHADED:
        light = {"light": "results/workspace/light.json"}
    if wildcards.renderer == "gs_soft":
        for name in ("item", "background"):
            scene = wildcards.object if name == "item" else wildcards.background
            light[f"{name}_splats"] = f"results/scenes/{scene}/splats/soft/splats.ply"
    return {
        **light,
        **simulated_world(
            wildcards.object, wildcards.background, variant_of(wildcards)["model"]
        ),
        **workspace_of(variant_of(wildcards)),
        "views": f"{item}/align/views.json",
        "images": f"{item}/sfm/images",
        "masks": f"{item}/masks/images",
    }


def variant_of(wildcards):
    """What a variant changes of the paper's way."""
    return config["variants"][wildcards.variant]


def policy_settings(wildcards):
    """How a policy learns: the settings of its task, those of the preset, and those of its variant."""
    return {**settings(f"{wildcards.task}_policy"), **variant_of(wildcards)["policy"]}


def policy_state(wildcards):
    """Where a training keeps its checkpoint."""
    key = policy_settings(wildcards), variant_of(wildcards)
    return state_folder("train_policy", wildcards, *key)


def world_settings(wildcards):
    """Seed of a world of the mirror, the configuration's unless it names one, its severity and its hidden changes."""
    # The mirror itself is there for controllers whether or not policies are tried in it.
    plain = {"seed": None, "severity": 0, "hidden": {}}
    world = config["worlds"].get(wildcards.get("world", "mirror"), plain)
    return {**world, "seed": SEED if world["seed"] is None else world["seed"]}


def trial_registration(wildcards):
    """Where arm and table are believed to stand in a world of the mirror."""
    variant = wildcards.get("variant", "default")
    return PLAN.trial_registration(wildcards.world, variant)


def trial_state(world, wildcards, input):
    """Where finished trials are kept until all are done. Another policy, which is another file, finds another folder."""
    script = "try_policy_in_sim" if world == "sim" else "try_policy_in_mirror"
    files = (Path(path) for path in input if Path(path).is_file())
    made = [hashlib.sha256(path.read_bytes()).hexdigest() for path in files]
    key = settings("trials"), made, SEED, config["worlds"].get(world)
    return state_folder(script, wildcards, *key)


def pictured(wildcards):
    """Trials that pictures of a policy show."""
    return TABLES.pictured(type(ANY)(**dict(wildcards.items())))


def shown_trials(ending):
    """Input function: tables or logs of those trials."""
    return lambda wildcards: [trial.file(ending) for trial in pictured(wildcards)]


# Pages


def rows_of(names):
    """Tables of rows by their names."""
    return [f"results/rows/{name}.csv" for name in names]


def measured_rows(name):
    """Rows about policies that a score is made of; nothing where the preset trains none."""
    return f"results/rows/{name}.csv" if name in TABLES.rows else []


def compared_rows(who):
    """Rows of a comparison at different severities that a score is made of; nothing where nobody is compared."""
    return f"results/rows/{who}.csv" if SEVERITY.compares(who) else []


# The gap


@told()
def gap_case(wildcards):
    """A case's file: relative to where snakemake runs, or to the project; the loop's are made by the workflow."""
    if wildcards.case in LOOP.cases:
        return f"results/loop/cases/{wildcards.case}.yaml"
    found = case_path(wildcards.case, GAP_CASES[wildcards.case], CASE_PLACES)
    if workflow.is_main_process:
        check_named(found, Path("results"))
    return PLAN.portable(found)


@told()
def gap_case_files(wildcards):
    """Files that a case names, which are read with it."""
    if wildcards.case in LOOP.cases:
        return LOOP.case_files(wildcards.case)
    return [local(PLAN.portable(path)) for path in case_files(gap_case(wildcards))]


@told()
def gap_model(wildcards):
    """The model that a case diagnoses."""
    if wildcards.case in LOOP.cases:
        return LOOP.model(wildcards.case)
    # As the rule that amends a model writes it, where the case names one of those.
    return PLAN.portable(os.path.normpath(case_model(gap_case(wildcards))))


wildcard_constraints:
    scene=one_of(config["scenes"]),
    camera=one_of(config["cameras"]),
    binding=one_of(BINDINGS),
    surface="visual|hull",
    task="grasp|pick_and_place",
    seed=r"\d+",
    origin="mirror|real",
    table="grasping|renderer_contrast|pick_and_place|worlds|picture_gap",
    case=one_of([*GAP_CASES, *LOOP.cases]),
    tier="t[0-9]",
    method="[a-z_]+",
    chunk=r"[0-9]+",
