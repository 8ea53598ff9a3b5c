rule play_episode:
    input:
        robot="results/robot/description",
        robot_splats="results/robot/splats",
        registration="results/workspace/registration.json",
        photometry="results/workspace/photometry.json",
        light="results/workspace/light.json",
        item="results/scenes/{object}/asset/asset.json",
        background="results/scenes/{background}/asset/asset.json",
        model=project_file("models/nominal.yaml"),
        views="results/scenes/{object}/align/views.json",
        images="results/scenes/{object}/sfm/images",
        masks="results/scenes/{object}/masks/images",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        episode="results/episodes/{object}+{background}/episode.npz",
        states="results/episodes/{object}+{background}/states.json",
        record="results/episodes/{object}+{background}/episode.json",
    log:
        "results/logs/play_episode/{object}+{background}.log",
    benchmark:
        "results/benchmarks/play_episode/{object}+{background}.jsonl"
    wildcard_constraints:
        object=one_of(OBJECTS),
        background=one_of(BACKGROUNDS),
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="20m",
    params:
        code=script_digest("play_episode"),
        size=settings("episodes")["size"],
        task=lambda wildcards: PLAN.task_of(wildcards.object, wildcards.background),
    message:
        "Play an episode with {wildcards.object} on {wildcards.background}"
    script:
        "../scripts/play_episode.py"


rule photograph_episode:
    input:
        states="results/episodes/{object}+{background}/states.json",
        item="results/scenes/{object}/asset/asset.json",
    output:
        photos=directory("results/episodes/{object}+{background}/mirror"),
        record="results/episodes/{object}+{background}/mirror.json",
    log:
        "results/logs/photograph_episode/{object}+{background}.log",
    benchmark:
        "results/benchmarks/photograph_episode/{object}+{background}.jsonl"
    wildcard_constraints:
        object=one_of(IN_MIRROR.intersection(OBJECTS)),
        background=one_of(IN_MIRROR.intersection(BACKGROUNDS)),
    conda:
        "../envs/world.yaml"
    threads: MANY_THREADS
    resources:
        mem_mb=2500,
        runtime="60m",
    params:
        code=script_digest("photograph_episode"),
        settings=settings("episodes"),
        sheet=settings("films")["sheet"],
        pieces="results/.state/pieces",
        seed=SEED,
    message:
        "Photograph the episode with {wildcards.object} on {wildcards.background} in the mirror"
    script:
        "../scripts/photograph_episode.py"


rule record_episode:
    input:
        unpack(episode_photos),
        episode="results/episodes/{object}+{background}/episode.npz",
        robot="results/robot/description",
        item="results/scenes/{object}/asset/asset.json",
        background="results/scenes/{background}/asset/asset.json",
    output:
        recording="results/rerun/episode/{object}+{background}.rrd",
    log:
        "results/logs/record_episode/{object}+{background}.log",
    benchmark:
        "results/benchmarks/record_episode/{object}+{background}.jsonl"
    wildcard_constraints:
        object=one_of(OBJECTS),
        background=one_of(BACKGROUNDS),
    conda:
        "../envs/report.yaml"
    resources:
        runtime="10m",
        mem_mb=2000,
    params:
        code=script_digest("record_episode"),
    message:
        "Record the episode with {wildcards.object} on {wildcards.background}"
    script:
        "../scripts/record_episode.py"
