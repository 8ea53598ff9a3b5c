"""Which policies and trials there are, and functions that rules about them share; no rule stands here."""

# What a policy is named after in logs; its path has slashes instead.
POLICY_ITEM = "{task}-{object}+{background}-{renderer}-{variant}-seed{seed}"
# The same for all seeds together.
CELL_ITEM = "{task}-{object}+{background}-{renderer}-{variant}"
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
    # Meshes have no shadows, and need not learn anew where the light was calibrated anew.
    light = (
        {"light": "results/workspace/light.json"} if wildcards.renderer == "gs" else {}
    )
    return {
        **light,
        "robot": "results/robot/description",
        "robot_splats": "results/robot/splats",
        "registration": "results/workspace/registration.json",
        "photometry": "results/workspace/photometry.json",
        "item": f"{item}/asset/asset.json",
        "background": f"results/scenes/{wildcards.background}/asset/asset.json",
        # A model that the workflow makes lies where it runs, others in the project.
        "model": model if model.startswith("results/") else str(ROOT / model),
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


def policy_memory(wildcards):
    """Memory of a training, MB: libraries and pictures in use, the replay, and each further environment."""
    chosen = policy_settings(wildcards)
    replay = 3e-6 * chosen["replay_capacity"] * chosen["image_size"] ** 2
    return round(2350 + replay + 400 * (chosen["environments"] - 1))


def policy_minutes(wildcards):
    """Time limit of a training, minutes: with room for slow machines."""
    return max(60, round(policy_settings(wildcards)["steps"] / 100))


def policy_state(wildcards):
    """Where a training keeps its checkpoint."""
    return state_folder(
        "train_policy",
        "-".join(wildcards),
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
    script = "try_policy_in_sim" if world == "sim" else "try_policy_in_mirror"
    made = [
        hashlib.sha256(Path(path).read_bytes()).hexdigest()
        for path in (input.weights, input.item)
    ]
    hidden = config["worlds"].get(world)
    return state_folder(
        script, "-".join(wildcards), settings("trials"), made, SEED, hidden
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


def policy_place(policy):
    """Folder of a policy's cell below `policies/` or `trials/`."""
    pair = f"{policy['object']}+{policy['background']}"
    return f"{policy['task']}/{pair}/{policy['renderer']}/{policy['variant']}"


def policies_of(table):
    """Policies that a table of successes shows; those trained on a mesh stand beside the splats of the same cell."""
    if table == "worlds":
        return [policy for policy in POLICIES if policy["renderer"] == "gs"]
    if table == "sight":
        plan = config["study"]
        return [
            {**plan["cell"], "renderer": "gs", "variant": name}
            for name in plan["sight"]["variants"]
        ]
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


def policy_trials(policies, ending, worlds=WORLDS):
    """Trials of policies in worlds; the mirrors have their own scenes only."""
    return [
        f"results/trials/{policy_place(policy)}/{world}/seed{seed}.{ending}"
        for policy in policies
        for world in worlds
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


def worlds_of(table):
    """Worlds that a table of successes shows."""
    plan = config["study"]
    further = {"worlds": plan["worlds"], "sight": plan["sight"]["worlds"]}
    return ["sim", *further[table]] if table in further else WORLDS


def table_trials(wildcards):
    """Trials that a table of successes is made of."""
    table = wildcards.table
    return policy_trials(policies_of(table), "csv", worlds_of(table))


def table_trial_records(wildcards):
    """Records of the same trials."""
    table = wildcards.table
    return policy_trials(policies_of(table), "json", worlds_of(table))


def table_robot_trials(wildcards):
    """A user's own trials that stand in a table of successes, by the place of their policy."""
    if wildcards.table not in success_tables():
        return {}
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


def further_pages(wildcards):
    """Pages about policies in further worlds, where any are named."""
    plan = config["study"]
    named = {"worlds": plan["worlds"], "sight": plan["sight"]["worlds"]}
    return [
        f"results/{table}.md"
        for table, worlds in named.items()
        if worlds and policies_of(table)
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
