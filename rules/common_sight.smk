"""The gap of pictures on one cell: files that its rules share; no rule stands here."""

SIGHT = config["study"]["sight"]
SIGHT_CELL = {**config["study"]["cell"], "renderer": "gs", "seed": SEED}
# Photos of one posture in the reference: the one that is compared, further ones, and one that stands for a later day.
SIGHT_SHOTS = SIGHT["repeats"] + 2
# Worlds that are photographed. The reference itself is diagnosed too: nothing may be found in it.
SIGHT_WORLDS = [SIGHT["reference"], *SIGHT["amended"]] if SIGHT["amended"] else []


def sight_shots(wildcards):
    """Photos of each posture in a world."""
    return SIGHT_SHOTS if wildcards.world == SIGHT["reference"] else 1


def sight_trials():
    """Variant and world of each row of the table: what was there before, and what learned anew."""
    before = [
        {"variant": variant, "world": world}
        for variant in SIGHT["variants"]
        for world in ("sim", *SIGHT_WORLDS)
    ]
    after = [
        {"variant": variant, "world": place}
        for world, variants in SIGHT["amended"].items()
        for variant in variants
        for place in ("sim", world)
    ]
    return before + after


def sight_tables():
    """Trials of those rows."""
    return [
        trial_file(plan["world"], "csv").format(**SIGHT_CELL, variant=plan["variant"])
        for plan in sight_trials()
    ]


def sight_trainings():
    """Records of the trainings of those policies."""
    variants = dict.fromkeys(plan["variant"] for plan in sight_trials())
    return [
        policy_file("training.json").format(**SIGHT_CELL, variant=variant)
        for variant in variants
    ]


def sight_loop_rows(wildcards):
    """The table; none where no policy learns with what photos say."""
    return ["results/rows/sight_loop.csv"] if SIGHT["amended"] else []


def learns_alike(variant):
    """The variant of the table that differs from one which learned anew in its model alone."""

    def rest(name):
        return {
            key: value
            for key, value in config["variants"][name].items()
            if key != "model"
        }

    alike = [name for name in SIGHT["variants"] if rest(name) == rest(variant)]
    return alike[0] if alike else ""


def closed_loops():
    """Worlds that changed, with the policies before and after, and the table that they stand in."""
    loops = []
    if LOOP["variant"] != "default":
        loops.append(
            {
                "table": "loop",
                "reference": LOOP["reference"],
                "world": LOOP["changed"],
                "before": "default",
                "after": LOOP["variant"],
            }
        )
    for world, variants in SIGHT["amended"].items():
        after = variants[0] if variants else ""
        loops.append(
            {
                "table": "sight_loop",
                "reference": SIGHT["reference"],
                "world": world,
                "before": learns_alike(after) if after else "default",
                "after": after,
            }
        )
    return loops


def measured_loops(wildcards):
    """Rows of the loops that are configured."""
    names = {loop["table"] for loop in closed_loops()}
    return {name: f"results/rows/{name}.csv" for name in sorted(names)}


def sight_scene(wildcards):
    """All that the simulated world of the cell is made of."""
    return {
        "robot": "results/robot/description",
        "robot_splats": "results/robot/splats",
        "registration": "results/workspace/registration.json",
        "photometry": "results/workspace/photometry.json",
        "light": "results/workspace/light.json",
        "item": f"results/scenes/{SIGHT_CELL['object']}/asset/asset.json",
        "background": f"results/scenes/{SIGHT_CELL['background']}/asset/asset.json",
        "model": project_file("models/nominal.yaml"),
        "kernels": ancient("results/.state/compile_kernels.done"),
    }
