rule try_controller_in_sim:
    input:
        robot="results/robot/description",
        registration="results/workspace/registration.json",
        item="results/scenes/{object}/asset/asset.json",
        background="results/scenes/{background}/asset/asset.json",
        model=project_file("models/nominal.yaml"),
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        record="results/trials/{task}/{object}+{background}/sim.json",
    log:
        "results/logs/try_controller_in_sim/{task}-{object}+{background}.log",
    benchmark:
        "results/benchmarks/try_controller_in_sim/{task}-{object}+{background}.jsonl"
    wildcard_constraints:
        object=one_of(OBJECTS),
        background=one_of(BACKGROUNDS),
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="60m",
    params:
        code=script_digest("try_controller_in_sim"),
        trials=settings("trials"),
    message:
        "Try the controller in simulation: {wildcards.task}, {wildcards.object} on {wildcards.background}"
    script:
        "../scripts/try_controller_in_sim.py"


rule try_controller_in_mirror:
    input:
        registration=trial_registration,
        item="results/scenes/{object}/asset/asset.json",
        background="results/scenes/{background}/asset/asset.json",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        record="results/trials/{task}/{object}+{background}/{world}.json",
    log:
        "results/logs/try_controller_in_mirror/{task}-{object}+{background}-{world}.log",
    benchmark:
        "results/benchmarks/try_controller_in_mirror/{task}-{object}+{background}-{world}.jsonl"
    wildcard_constraints:
        object=one_of(IN_MIRROR.intersection(OBJECTS)),
        background=one_of(IN_MIRROR.intersection(BACKGROUNDS)),
        world=one_of({"mirror", *config["worlds"]}),
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime="60m",
    params:
        code=script_digest("try_controller_in_mirror"),
        trials=settings("trials"),
        world=world_settings,
        pieces="results/.state/pieces",
        seed=SEED,
    message:
        "Try the controller in {wildcards.world}: {wildcards.task}, {wildcards.object} on {wildcards.background}"
    script:
        "../scripts/try_controller_in_mirror.py"


rule check_simulator:
    input:
        robot="results/robot/description",
        registration="results/workspace/registration.json",
        item=lambda wildcards: PLAN.first_asset("object"),
        background=lambda wildcards: PLAN.first_asset("background"),
        model=project_file("models/nominal.yaml"),
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        record="results/robot/simulator.json",
    log:
        "results/logs/check_simulator.log",
    benchmark:
        "results/benchmarks/check_simulator/all.jsonl"
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("check_simulator"),
    message:
        "Compare the simulated arm with another engine's, and an episode with itself"
    script:
        "../scripts/check_simulator.py"


rule benchmark_environment:
    input:
        robot_splats="results/robot/splats",
        item=lambda wildcards: PLAN.first_asset("object"),
        background=lambda wildcards: PLAN.first_asset("background"),
        light="results/workspace/light.json",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        benchmark="results/benchmarks/environment.json",
    log:
        "results/logs/benchmark_environment.log",
    benchmark:
        "results/benchmarks/benchmark_environment/all.jsonl"
    conda:
        "../envs/world.yaml"
    # Alone on the machine: the figures are times.
    threads: MANY_THREADS
    resources:
        mem_mb=1000,
        runtime="60m",
    params:
        code=code_digest("benchmarks.environment"),
        program=program("environment"),
    message:
        "Time the environment"
    shell:
        "{params.program} --item {input.item} --background {input.background}"
        " --robot-splats {input.robot_splats} --light {input.light} --output {output.benchmark} > {log} 2>&1"


rule score_registration:
    input:
        truth="results/truth/workspace/registration.json",
        registration="results/workspace/registration.json",
    output:
        scores="results/scores/workspace/registration.json",
    log:
        "results/logs/score_registration.log",
    benchmark:
        "results/benchmarks/score_registration/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_registration"),
    message:
        "Score the registration against the mirror's truth"
    script:
        "../scripts/score_registration.py"


rule simulator:
    input:
        "results/scores/simulator.json",
        "results/figures/eye_in_hand.png",
        "results/figures/gs_editing.png",
        collect("results/rerun/episode/{pair}.rrd", pair=PLAN.preset_pairs),
    localrule: True


rule score_simulator:
    input:
        floors=project_file("benchmarks/floors.yaml"),
        assets=collect(
            "results/scenes/{scene}/asset/asset.json",
            scene=[scene for scene in PLAN.bundled if scene in OBJECTS],
        ),
        sim=PLAN.controller_trials("sim"),
        mirror=PLAN.controller_trials("mirror"),
        checks="results/robot/simulator.json",
        views=collect("results/views/{pair}/drawn.json", pair=PLAN.pairs),
        eye_in_hand="results/rows/eye_in_hand.csv",
        registration="results/scores/workspace/registration.json",
        environment="results/benchmarks/environment.json",
    output:
        measured="results/scores/measured/simulator.json",
        scores="results/scores/simulator.json",
    log:
        "results/logs/score_simulator.log",
    benchmark:
        "results/benchmarks/score_simulator/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_simulator"),
        behind=provenance("simulator", config),
        preset=config["preset"],
    message:
        "Compare the simulator with the floors"
    script:
        "../scripts/score_simulator.py"
