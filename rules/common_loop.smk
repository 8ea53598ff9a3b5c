"""Closing the loop on one cell: files that its rules share; no rule stands here."""

LOOP = config["loop"]
LOOP_CELL = {**LOOP["cell"], "renderer": "gs", "seed": SEED}
LOOP_ROLES = ["fit", "select", "verify"]
# Cases of the gap that the workflow makes by itself, beside those of the configuration.
LOOP_CASES = {
    "loop_reference": {"world": LOOP["reference"], "model": "nominal"},
    "loop_changed": {"world": LOOP["changed"], "model": "calibrated"},
}
LOOP_TRIALS = [
    {"variant": "default", "world": "sim"},
    {"variant": "default", "world": LOOP["reference"]},
    {"variant": "default", "world": LOOP["changed"]},
    {"variant": LOOP["variant"], "world": "sim"},
    {"variant": LOOP["variant"], "world": LOOP["changed"]},
]


def loop_rows(wildcards):
    """The loop's table; none without a variant that learns with what was found."""
    return [] if LOOP["variant"] == "default" else ["results/rows/loop.csv"]


def loop_trials(world, ending, variant="default"):
    """Trials of the loop's cell in one world."""
    return trial_file(world, ending).format(**LOOP_CELL, variant=variant)


def loop_records(world):
    """Logs of the arm from trials in one world, by role."""
    return {role: f"results/loop/records/{world}/{role}.csv" for role in LOOP_ROLES}


def loop_model(case):
    """The arm's model in one of the loop's cases."""
    return f"results/loop/arm/{LOOP_CASES[case]['model']}.yaml"


def loop_case(wildcards):
    """What one of the loop's cases is made of."""
    plan = LOOP_CASES[wildcards.case]
    calibrated = plan["model"] == "calibrated"
    return {
        "model": loop_model(wildcards.case),
        **loop_records(plan["world"]),
        "calibration": "results/loop/arm/calibration.json" if calibrated else [],
    }


def loop_case_files(case):
    """Files that one of the loop's cases names."""
    records = loop_records(LOOP_CASES[case]["world"]).values()
    return [loop_model(case), "results/loop/arm/arm.urdf", *records]


def loop_tables():
    """Trials of all policies and worlds of the loop's table."""
    return [loop_trials(plan["world"], "csv", plan["variant"]) for plan in LOOP_TRIALS]


def loop_trainings():
    """Records of the trainings before and after."""
    return [
        policy_file("training.json").format(**LOOP_CELL, variant=variant)
        for variant in ("default", LOOP["variant"])
    ]
