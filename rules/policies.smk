rule train_policy:
    input:
        unpack(simulated_scene),
    output:
        weights=ANY.file("{seed}", "policy.safetensors"),
        spec=ANY.file("{seed}", "policy.json"),
        onnx=ANY.file("{seed}", "policy.onnx"),
        curve=ANY.file("{seed}", "training.csv"),
        record=ANY.file("{seed}", "training.json"),
    log:
        f"results/logs/train_policy/{POLICY_ITEM}.log",
    benchmark:
        f"results/benchmarks/train_policy/{POLICY_ITEM}.jsonl"
    wildcard_constraints:
        object=one_of(OBJECTS),
        background=one_of(BACKGROUNDS),
        renderer=one_of(RENDERERS),
        variant=one_of(config["variants"]),
    # The longest way to the tables goes through here.
    priority: 10
    conda:
        "../envs/policy.yaml"
    # One per environment that is played in at a time.
    threads: lambda wildcards: policy_settings(wildcards)["environments"]
    resources:
        mem_mb=lambda wildcards: training_memory(policy_settings(wildcards)),
        runtime=lambda wildcards: training_minutes(policy_settings(wildcards)),
        gpu=lambda wildcards: int(policy_settings(wildcards)["device"] == "cuda"),
    params:
        code=script_digest("train_policy"),
        settings=policy_settings,
        controller_offset=lambda wildcards: variant_of(wildcards)["controller_offset"],
        unchanged_teacher=lambda wildcards: variant_of(wildcards)["unchanged_teacher"],
        state=policy_state,
    message:
        "Train the policy {wildcards.variant} to {wildcards.task} {wildcards.object} on {wildcards.background} as seen by {wildcards.renderer}"
    script:
        "../scripts/train_policy.py"


rule try_policy_in_sim:
    input:
        unpack(simulated_scene),
        spec=ANY.file("{seed}", "policy.json"),
        weights=ANY.file("{seed}", "policy.safetensors"),
        training=ANY.file("{seed}", "training.json"),
    output:
        table=ANY.trials("sim", "{seed}", "csv"),
        log=ANY.trials("sim", "{seed}", "npz"),
        record=ANY.trials("sim", "{seed}", "json"),
    log:
        f"results/logs/try_policy_in_sim/{POLICY_ITEM}.log",
    benchmark:
        f"results/benchmarks/try_policy_in_sim/{POLICY_ITEM}.jsonl"
    wildcard_constraints:
        object=one_of(OBJECTS),
        background=one_of(BACKGROUNDS),
        renderer=one_of(RENDERERS),
        variant=one_of(config["variants"]),
    # The longest way to the tables goes through here.
    priority: 10
    conda:
        "../envs/policy.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="60m",
    params:
        code=script_digest("try_policy_in_sim"),
        image_size=lambda wildcards: policy_settings(wildcards)["image_size"],
        poses=settings("trials")["poses"],
        outside=settings("trials")["outside"],
        state=lambda wildcards, input: trial_state("sim", wildcards, input),
    message:
        "Try the policy {wildcards.variant} in simulation: {wildcards.task} {wildcards.object} on {wildcards.background}, {wildcards.renderer}"
    script:
        "../scripts/try_policy_in_sim.py"


rule try_policy_in_mirror:
    input:
        spec=ANY.file("{seed}", "policy.json"),
        weights=ANY.file("{seed}", "policy.safetensors"),
        training=ANY.file("{seed}", "training.json"),
        registration=trial_registration,
    output:
        table=ANY.trials("{world}", "{seed}", "csv"),
        log=ANY.trials("{world}", "{seed}", "npz"),
        record=ANY.trials("{world}", "{seed}", "json"),
    log:
        f"results/logs/try_policy_in_mirror/{POLICY_ITEM}-{{world}}.log",
    benchmark:
        f"results/benchmarks/try_policy_in_mirror/{POLICY_ITEM}-{{world}}.jsonl"
    wildcard_constraints:
        object=one_of(IN_MIRROR.intersection(OBJECTS)),
        background=one_of(IN_MIRROR.intersection(BACKGROUNDS)),
        renderer=one_of(RENDERERS),
        variant=one_of(config["variants"]),
        world=one_of(config["worlds"]),
    # The longest way to the tables goes through here.
    priority: 10
    conda:
        "../envs/policy.yaml"
    threads: 1
    resources:
        mem_mb=2500,
        runtime="4h",
    params:
        code=script_digest("try_policy_in_mirror"),
        poses=settings("trials")["poses"],
        outside=settings("trials")["outside"],
        world=world_settings,
        sheet=settings("films")["sheet"],
        pieces="results/.state/pieces",
        seed=SEED,
        state=lambda wildcards, input: trial_state(wildcards.world, wildcards, input),
    message:
        "Try the policy {wildcards.variant} in {wildcards.world}: {wildcards.task} {wildcards.object} on {wildcards.background}, {wildcards.renderer}"
    script:
        "../scripts/try_policy_in_mirror.py"
