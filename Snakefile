"""gsbridge: photos or a video in, a metric scene of mesh-bound Gaussians out. A table of contents; see rules/."""

import os
import sys
from pathlib import Path

from gsbridge.configuration.whole import read_configuration
from gsbridge.workflow_backups import link_backups
from gsbridge.workflow_faults import told
from gsbridge.workflow_files import check_configuration_files
from gsbridge.workflow_lock import end_when_asked
from gsbridge.workflow_plan import is_dry, summarize_plans
from gsbridge.workflow_storage import see_new_folders
from gsbridge.workflow_targets import check_targets, targets_of
from snakemake.cli import get_argument_parser
from snakemake.utils import min_version

min_version("9.19")


# Folder of this file, also where workflow/Snakefile includes it.
ROOT = Path(os.path.abspath(workflow.current_basedir.get_path_or_uri(secret_free=True)))
# Before snakemake reads them: it names no line.
with told():
    check_configuration_files([f"{ROOT}/config.yaml", *workflow.configfiles])


configfile: f"{ROOT}/config.yaml"


# With all defaults, and numbers for what came as text.
with told():
    config.update(read_configuration(config))


if workflow.is_main_process:
    summarize_plans(
        logger, lambda: workflow.rules, is_dry(sys.argv, get_argument_parser)
    )


# Snakemake removes what a rule makes before it runs. What rules make from things of the user's, which they may refuse, is kept
# until there is something better; in a bucket that is beyond snakemake.
kept = update
link_backups()
if workflow.storage_settings.default_storage_provider is not None:
    kept = lambda output: output


report: "rules/captions/workflow.rst"


onstart:
    end_when_asked()
    see_new_folders()


include: "rules/common.smk"
include: "rules/film.smk"
include: "rules/capture.smk"
include: "rules/sfm.smk"
include: "rules/align.smk"
include: "rules/registration.smk"
include: "rules/masks.smk"
include: "rules/mesh.smk"
include: "rules/splats.smk"
include: "rules/assets.smk"
include: "rules/views.smk"
include: "rules/simulator.smk"
include: "rules/policies.smk"
include: "rules/behaviour.smk"
include: "rules/study.smk"
include: "rules/episodes.smk"
include: "rules/editing.smk"
include: "rules/gap.smk"
include: "rules/gap_benchmark.smk"
include: "rules/loop.smk"
include: "rules/controls.smk"
include: "rules/picture_gap.smk"
include: "rules/report.smk"
include: "rules/recordings.smk"
include: "rules/scores.smk"


rule all:
    default_target: True
    input:
        "results/tables",
        PLAN.stage_recordings,
        TABLES.recordings,
    localrule: True


if workflow.is_main_process and OWN_TARGETS:
    with told():
        check_targets(targets_of(sys.argv, get_argument_parser), workflow.rules)
