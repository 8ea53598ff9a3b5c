rule compare_behaviour:
    input:
        tables=[trial.file("csv") for trial in TABLES.compared],
        logs=[trial.file("npz") for trial in TABLES.compared],
    output:
        figure=report(
            "results/figures/behaviour_consistency.png",
            caption="captions/behaviour_consistency.rst",
            category="Policies",
            labels={"result": "behaviour in both worlds", "of": "every cell"},
        ),
        rows="results/rows/behaviour_consistency.csv",
    log:
        "results/logs/compare_behaviour.log",
    benchmark:
        "results/benchmarks/compare_behaviour/all.jsonl"
    conda:
        "../envs/report.yaml"
    threads: 1
    resources:
        runtime="10m",
        mem_mb=2000,
    params:
        code=script_digest("compare_behaviour"),
        cells=[asdict(trial.policy) for trial in TABLES.compared],
        worlds=[trial.world for trial in TABLES.compared],
        seeds=[trial.seed for trial in TABLES.compared],
    message:
        "Compare the hand's paths in simulation and in the mirror"
    script:
        "../scripts/compare_behaviour.py"


rule film_trials:
    input:
        tables=shown_trials("csv"),
        logs=shown_trials("npz"),
    output:
        film=report(
            f"results/films_of_trials/{ANY.item}.webp",
            caption="captions/film_of_trials.rst",
            category="Policies",
            labels={
                "result": "film of trials",
                "of": "{task} {object} on {background}, {renderer}, {variant}",
            },
        ),
    log:
        f"results/logs/film_trials/{ANY.item}.log",
    benchmark:
        f"results/benchmarks/film_trials/{ANY.item}.jsonl"
    wildcard_constraints:
        object=one_of(OBJECTS),
        background=one_of(BACKGROUNDS),
        renderer=one_of(RENDERERS),
        variant=one_of(config["variants"]),
    conda:
        "../envs/report.yaml"
    threads: 1
    resources:
        runtime="60m",
        mem_mb=2000,
    params:
        code=script_digest("film_trials"),
        worlds=lambda wildcards: [trial.world for trial in pictured(wildcards)],
        seeds=lambda wildcards: [trial.seed for trial in pictured(wildcards)],
    message:
        "Film the trials: {wildcards.task} {wildcards.object} on {wildcards.background}, {wildcards.renderer}, {wildcards.variant}"
    script:
        "../scripts/film_trials.py"


rule film_onlooker:
    input:
        unpack(
            lambda wildcards: simulated_world(wildcards.object, wildcards.background)
        ),
        light="results/workspace/light.json",
        tables=shown_trials("csv"),
        logs=shown_trials("npz"),
    output:
        film=report(
            f"results/onlooker_films/{ANY.item}.webp",
            caption="captions/film_onlooker.rst",
            category="Policies",
            labels={
                "result": "the arm, seen from beside the table",
                "of": "{task} {object} on {background}, {renderer}, {variant}",
            },
        ),
    log:
        f"results/logs/film_onlooker/{ANY.item}.log",
    benchmark:
        f"results/benchmarks/film_onlooker/{ANY.item}.jsonl"
    wildcard_constraints:
        object=one_of(OBJECTS),
        background=one_of(BACKGROUNDS),
        renderer=one_of(RENDERERS),
        variant=one_of(config["variants"]),
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        runtime="60m",
        mem_mb=2000,
    params:
        code=script_digest("film_onlooker"),
        worlds=lambda wildcards: [trial.world for trial in pictured(wildcards)],
        seeds=lambda wildcards: [trial.seed for trial in pictured(wildcards)],
    message:
        "Film the arm from beside the table: {wildcards.task} {wildcards.object} on {wildcards.background}, {wildcards.renderer}, {wildcards.variant}"
    script:
        "../scripts/film_onlooker.py"


rule draw_overview:
    input:
        unpack(
            lambda wildcards: simulated_world(wildcards.object, wildcards.background)
        ),
        light="results/workspace/light.json",
        item_views="results/scenes/{object}/align/views.json",
        item_images="results/scenes/{object}/sfm/images",
        background_views="results/scenes/{background}/align/views.json",
        background_images="results/scenes/{background}/sfm/images",
        tables=shown_trials("csv"),
        logs=shown_trials("npz"),
    output:
        picture=f"results/overview/{ANY.item}.jpg",
        clip=f"results/overview/{ANY.item}.webp",
    log:
        f"results/logs/draw_overview/{ANY.item}.log",
    benchmark:
        f"results/benchmarks/draw_overview/{ANY.item}.jsonl"
    wildcard_constraints:
        object=one_of(OBJECTS),
        background=one_of(BACKGROUNDS),
        renderer=one_of(RENDERERS),
        variant=one_of(config["variants"]),
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        runtime="60m",
        mem_mb=2000,
    params:
        code=script_digest("draw_overview"),
        worlds=lambda wildcards: [trial.world for trial in pictured(wildcards)],
        seeds=lambda wildcards: [trial.seed for trial in pictured(wildcards)],
        filmed=lambda wildcards: {
            "item": PLAN.camera_of(wildcards.object),
            "background": PLAN.camera_of(wildcards.background),
        },
    message:
        "Draw the whole way: {wildcards.task} {wildcards.object} on {wildcards.background}, {wildcards.renderer}, {wildcards.variant}"
    script:
        "../scripts/draw_overview.py"


rule record_trials:
    input:
        tables=shown_trials("csv"),
        logs=shown_trials("npz"),
        item="results/scenes/{object}/asset/asset.json",
        background="results/scenes/{background}/asset/asset.json",
    output:
        recording=f"results/rerun/trials/{ANY.item}.rrd",
    log:
        f"results/logs/record_trials/{ANY.item}.log",
    benchmark:
        f"results/benchmarks/record_trials/{ANY.item}.jsonl"
    wildcard_constraints:
        object=one_of(OBJECTS),
        background=one_of(BACKGROUNDS),
        renderer=one_of(RENDERERS),
        variant=one_of(config["variants"]),
    conda:
        "../envs/report.yaml"
    threads: 1
    resources:
        runtime="10m",
        mem_mb=2000,
    params:
        code=script_digest("record_trials"),
        worlds=lambda wildcards: [trial.world for trial in pictured(wildcards)],
        seeds=lambda wildcards: [trial.seed for trial in pictured(wildcards)],
    message:
        "Record the trials: {wildcards.task} {wildcards.object} on {wildcards.background}, {wildcards.renderer}, {wildcards.variant}"
    script:
        "../scripts/record_trials.py"


rule trial_pictures:
    input:
        TABLES.pictures,
    localrule: True
