"""Provenance of the recorded figures of an area: digests of the rules that made them, of the settings, and of model files.

Figures in `benchmarks/scores` outlive `results/`. The digests beside them tell whether the tree would still make the same
figures.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsbridge.digests import PACKAGE, code_digest

_SCENES = (
    "film_scene",
    "select_keyframes",
    "calibrate_camera",
    "reconstruct_cameras",
    "align_scene",
    "mesh_background",
    "train_splats",
)
_OBJECTS = ("segment_object", "mesh_object")
_WORKSPACE = (
    "film_board",
    "register_workspace",
    "calibrate_wrist_camera",
    "calibrate_light",
    "build_asset",
    "describe_robot",
    "fit_robot_splats",
)
_POLICIES = ("train_policy", "try_policy_in_sim")
_DRAWN = "generate_gap_cases"
_JUDGED = ("score_gap_cases", "score_gap")
_JOINTS = (_DRAWN, "diagnose_joint_cases", *_JUDGED)
_WORSE_DAYS = ("film_board_of_world", "register_world", "try_policy_in_mirror")
"""Rules of trials in worlds of some severity, in which the work place is registered anew."""

RULES: Mapping[str, tuple[str, ...]] = {
    "real2sim": (
        *_SCENES,
        *_OBJECTS,
        "train_comparison",
        "collect_rendering",
        "score_scene",
        "benchmark_rasterizer",
        "score_real2sim",
    ),
    "shapes": (
        *_SCENES,
        *_OBJECTS,
        "film_board",
        "register_workspace",
        "build_asset",
        "describe_robot",
        "score_scene",
        "measure_length",
        "try_controller_in_sim",
        "try_controller_in_mirror",
        "score_shapes",
    ),
    "photos": (
        "select_keyframes",
        "reconstruct_cameras",
        "align_scene",
        *_OBJECTS,
        "train_splats",
        "train_comparison",
        "train_by_recipe",
        "reconstruct_turned",
        "score_photos",
    ),
    "simulator": (
        *_SCENES,
        *_OBJECTS,
        *_WORKSPACE,
        "score_registration",
        "try_controller_in_sim",
        "try_controller_in_mirror",
        "check_simulator",
        "photograph_views",
        "draw_views",
        "compare_eye_in_hand",
        "benchmark_environment",
        "score_simulator",
    ),
    "policies": (
        *_SCENES,
        *_OBJECTS,
        *_WORKSPACE,
        *_POLICIES,
        "try_policy_in_mirror",
        "collect_success",
        "collect_training",
        "score_policies",
    ),
    "worlds": (
        *_SCENES,
        *_OBJECTS,
        *_WORKSPACE,
        *_POLICIES,
        "try_policy_in_mirror",
        "collect_success",
        "score_worlds",
    ),
    "severity": (
        *_SCENES,
        *_OBJECTS,
        *_WORKSPACE,
        *_POLICIES,
        *_WORSE_DAYS,
        "collect_severity_cells",
        "score_severity",
    ),
    "worth": (*_SCENES, *_OBJECTS, *_WORKSPACE, *_POLICIES, *_WORSE_DAYS, "collect_worth", "score_worth"),
    "study": (*_SCENES, *_OBJECTS, *_WORKSPACE, *_POLICIES, "collect_study", "score_study"),
    "gap": (*_JOINTS, "diagnose_mismatched_laws"),
    "gap_rivals": _JOINTS,
    "gap_bodies": (_DRAWN, "diagnose_thrown_cases", *_JUDGED),
    "gap_pictures": (*_SCENES, _DRAWN, "diagnose_photo_cases", *_JUDGED),
    "gap_real": ("diagnose_real_logs", "diagnose_real_arm", "score_gap"),
    "loops": (
        *_SCENES,
        *_OBJECTS,
        *_WORKSPACE,
        *_POLICIES,
        "try_policy_in_mirror",
        "describe_arm",
        "log_trials",
        "write_loop_case",
        "read_gap_records",
        "replay_gap",
        "compare_gap",
        "screen_gap",
        "identify_gap",
        "report_gap",
        "calibrate_arm",
        "amend_simulation",
        "draw_postures",
        "photograph_postures",
        "diagnose_photos",
        "report_photos",
        "amend_camera",
        "film_board_of_world",
        "register_world",
        "describe_robot_of_world",
        "calibrate_wrist_camera_of_world",
        "fit_robot_splats_of_world",
        "amend_arm_wrongly",
        "amend_camera_wrongly",
        "collect_loop",
        "collect_picture_loop",
        "score_loops",
    ),
}
"""Rules behind each area of `benchmarks/scores`, in the order of the work. A test compares them with the planned jobs."""

_MODULES = {
    "benchmark_rasterizer": "benchmarks.rasterizer",
    "benchmark_environment": "benchmarks.environment",
    "diagnose_mismatched_laws": "benchmarks.gap_mismatch",
    "diagnose_real_logs": "benchmarks.gap_measured",
    "diagnose_real_arm": "benchmarks.gap_so101",
    "train_comparison": "scripts.train_splats",
    "film_board_of_world": "scripts.film_board",
    "register_world": "scripts.register_workspace",
    "describe_robot_of_world": "scripts.describe_robot",
    "calibrate_wrist_camera_of_world": "scripts.calibrate_wrist_camera",
    "fit_robot_splats_of_world": "scripts.fit_robot_splats",
}
"""Modules of the rules that do not run the script of their own name."""

_BESIDE = ("areas", "captures", "gap_case", "presets")
"""Sections of the settings that change no recorded figure by themselves; of the presets, only the one that ran counts."""

_BLIND = ("gap", "gap_rivals", "gap_bodies", "gap_pictures")

_OF_SOME_AREAS: Mapping[str, tuple[str, ...]] = {
    **{f"gap.{key}": _BLIND for key in ("split", "benchmark", "chunks")},
    "gap.methods": ("gap_rivals",),
    "gap.contents": ("gap_pictures",),
}
"""Settings that only some areas read: the cases that the gap's benchmark draws and the methods that it compares change neither
a mesh nor a policy. A user's own cases, `gap.cases`, are not listed: they may amend the model that a policy learns with. A
test compares this with the rules' files."""

_LOGS = ("gap", "gap_rivals", "gap_bodies", "gap_real")
"""Areas about generated or recorded motions: their rules read no scene, no policy and no world of the mirror."""

_FOR_LOGS = ("gap", "preset", "presets", "seed")
"""Sections of the settings that the rules behind `_LOGS` read. A test compares this with the file of those rules."""


NOMINAL = "models/nominal.yaml"
"""The simulation model of every variant that names no other, and what the workflow's own models are made from."""

REFERENCES = "benchmarks/photos.json"
"""What is known of the real things of the area `photos`."""

_OF_NOMINAL = (
    *_POLICIES,
    "try_controller_in_sim",
    "check_simulator",
    "draw_views",
    "describe_arm",
    "amend_simulation",
    "draw_postures",
    "amend_camera",
    "amend_arm_wrongly",
    "amend_camera_wrongly",
)
"""Rules that read the nominal model. A test compares them with the rules' files."""


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:12]


def code_behind(area: str) -> dict[str, str]:
    """Digest of each rule behind an area of figures, {rule: digest}."""
    return {rule: code_digest(_MODULES.get(rule, f"scripts.{rule}")) for rule in RULES[area]}


def settings_behind(config: Mapping[str, Any]) -> dict[str, str]:
    """Digest of each setting, {`section` or `section.entry`: digest}.

    Each entry of a section has its own digest, so that a scene or a cell that is added later leaves the others as they were.
    """
    preset = config["preset"]
    sections = {name: value for name, value in config.items() if name not in _BESIDE}
    sections[f"presets.{preset}"] = config["presets"][preset]
    found = {}
    for name, value in sections.items():
        entries = {f"{name}.{key}": entry for key, entry in value.items()} if isinstance(value, Mapping) else {name: value}
        found.update({key: _digest(entry) for key, entry in entries.items()})
    return found


def matters(area: str, setting: str) -> bool:
    """Whether a setting can change figures of an area.

    Args:
        area: The area.
        setting: `section` or `section.entry`.
    """
    if area in _LOGS and setting.split(".")[0] not in _FOR_LOGS:
        return False
    return area in _OF_SOME_AREAS.get(setting, (area,))


def models_behind(area: str, config: Mapping[str, Any], root: str | Path = PACKAGE.parent) -> dict[str, str]:
    """Digest of each model file behind an area of figures, {path as configured: digest}; empty where no rule reads one.

    These are the nominal model, where policies learn the models that variants name, and what is known of real things. Models
    below `results/` do not count: the workflow makes them.

    Args:
        area: The area.
        config: The whole configuration.
        root: Folder that the paths start from, the project's.
    """
    named = []
    if not set(_OF_NOMINAL).isdisjoint(RULES[area]):
        named.append(NOMINAL)
    if "score_photos" in RULES[area]:
        named.append(REFERENCES)
    if not set(_POLICIES).isdisjoint(RULES[area]):
        given = {variant["model"] for variant in config["variants"].values()} - {None, NOMINAL}
        named += sorted(path for path in given if not path.startswith("results/"))
    return {name: _file_digest(Path(root) / name) for name in named}


def _file_digest(path: Path) -> str:
    """Digest of a file's content; a file that is missing is no reason to fail here, since the rule that reads it tells."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12] if path.is_file() else "missing"


def provenance(area: str, config: Mapping[str, Any], root: str | Path = PACKAGE.parent) -> dict[str, dict[str, str]]:
    """Digests of the code, the settings and the model files behind the figures of an area, as the tree is now.

    Args:
        area: The area.
        config: The whole configuration.
        root: Folder that the paths of model files start from, the project's.

    Returns:
        {`code`: {rule: digest}, `settings`: {setting: digest}, `models`: {path: digest}}; without `models` where no rule of the
        area reads a model.
    """
    settings = {name: digest for name, digest in settings_behind(config).items() if matters(area, name)}
    models = models_behind(area, config, root)
    return {"code": code_behind(area), "settings": settings, **({"models": models} if models else {})}


def provenances(config: Mapping[str, Any]) -> dict[str, dict[str, dict[str, str]]]:
    """`provenance` of every area, {area: {`code`, `settings`, `models`}}."""
    return {area: provenance(area, config) for area in RULES}
