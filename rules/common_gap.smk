"""Which cases of the gap there are, and functions that rules about them share; no rule stands here."""

import importlib.util

from gsbridge.gap.formats.files import (
    case_files,
    case_model,
    case_name,
    case_path,
    check_asked_cases,
    check_contents,
    check_own_cases,
)

GAP = settings("gap")
# A case of one's own needs no entry: `--config gap_case=FILE`.
GAP_CASES = {
    **GAP["cases"],
    **(
        {case_name(config["gap_case"]): config["gap_case"]}
        if config["gap_case"]
        else {}
    ),
}
GAP_BANK = "results/.state/gap_bank"
GAP_TIERS = list(GAP["benchmark"])
# The one way of naming that needs a package of its own; the page says what was left out.
GAP_METHODS = [
    name
    for name in GAP["methods"]
    if name != "cma_es" or importlib.util.find_spec("cma")
]

if workflow.is_main_process:
    check_asked_cases(sys.argv[1:], [*GAP_CASES, *LOOP_CASES])
    check_own_cases(GAP_CASES, LOOP_CASES)
    check_contents(GAP["contents"], config["scenes"])


def gap_case(wildcards):
    """A case's file: relative to where snakemake runs, or to the project; the loop's are made by the workflow."""
    if wildcards.case in LOOP_CASES:
        return f"results/loop/cases/{wildcards.case}.yaml"
    return str(case_path(wildcards.case, GAP_CASES[wildcards.case], [Path.cwd(), ROOT]))


def gap_case_files(wildcards):
    """Files that a case names, which are read with it."""
    if wildcards.case in LOOP_CASES:
        return loop_case_files(wildcards.case)
    return [str(path) for path in case_files(gap_case(wildcards))]


def gap_model(wildcards):
    """The model that a case diagnoses."""
    if wildcards.case in LOOP_CASES:
        return loop_model(wildcards.case)
    return str(case_model(gap_case(wildcards)))


def gap_reports(wildcards):
    """Reports and recordings of all cases."""
    return collect(
        ["results/gap/{case}/report.html", "results/rerun/gap/{case}.rrd"],
        case=list(GAP_CASES),
    )


def gap_state(wildcards):
    """Where a chunk of the benchmark keeps the findings that are done, until all are."""
    return state_folder("diagnose_gap_cases", "-".join(wildcards), SEED)


def real_logs(wildcards):
    """What is said about real logs, where GSBRIDGE_MEASURED names their folder."""
    return (
        {"real": "results/benchmarks/gap_measured.json"}
        if os.environ.get("GSBRIDGE_MEASURED")
        else {}
    )


def gap_methods(tier):
    """Ways of naming in one tier; CMA-ES on all parameters would draw every photo for every guess."""
    return [name for name in GAP_METHODS if (tier, name) != ("t4", "cma_es")]


def gap_contents(tier, kind):
    """Folders of pictures that lie on the tables of a tier's worlds: photos of scenes, or renders of their splats."""
    place = {"photos": "capture/frames", "renders": "splats/soft/views"}[kind]
    scenes = [name for name in GAP["contents"][kind] if name in SCENES]
    return [f"results/scenes/{name}/{place}" for name in scenes if tier == "t4"]


def gap_chunks(wildcards):
    """Findings of all ways of naming in one tier, a folder per chunk: those of a way lie side by side."""
    return [
        f"results/gap-benchmark/{wildcards.tier}/findings/{method}-{chunk}"
        for method in gap_methods(wildcards.tier)
        for chunk in range(GAP["chunks"])
    ]


wildcard_constraints:
    case=one_of([*GAP_CASES, *LOOP_CASES]),
    tier="t[0-9]",
    method="[a-z_]+",
    chunk=r"[0-9]+",
