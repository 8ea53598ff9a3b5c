rule compare_behaviour:
    input:
        tables=behaviour_files("csv"),
        logs=behaviour_files("npz"),
    output:
        figure=report(
            "results/figures/behaviour_consistency.png",
            caption="captions/behaviour_consistency.rst",
            category="Policies",
            labels={"figure": "behaviour in both worlds"},
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
        mem_mb=2000,
    params:
        code=script_digest("compare_behaviour"),
        cells=[cell for cell, _, _ in behaviour_trials()],
        worlds=[world for _, world, _ in behaviour_trials()],
        seeds=[seed for _, _, seed in behaviour_trials()],
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
            f"results/films_of_trials/{CELL_ITEM}.webp",
            caption="captions/film_of_trials.rst",
            category="Policies",
            labels={
                "figure": "film of trials",
                "cell": "{task} {object} on {background}, {renderer}, {variant}",
            },
        ),
    log:
        f"results/logs/film_trials/{CELL_ITEM}.log",
    benchmark:
        f"results/benchmarks/film_trials/{CELL_ITEM}.jsonl"
    wildcard_constraints:
        object=one_of(names("object")),
        background=one_of(names("background")),
        renderer="gs|mesh|mesh_vertex",
        variant=one_of(config["variants"]),
    conda:
        "../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        code=script_digest("film_trials"),
        worlds=shown_worlds,
        seeds=shown_seeds,
    message:
        "Film the trials: {wildcards.task} {wildcards.object} on {wildcards.background}, {wildcards.renderer}, {wildcards.variant}"
    script:
        "../scripts/film_trials.py"


rule record_trials:
    input:
        tables=shown_trials("csv"),
        logs=shown_trials("npz"),
        item="results/scenes/{object}/asset/asset.json",
        background="results/scenes/{background}/asset/asset.json",
    output:
        recording=f"results/rerun/trials/{CELL_ITEM}.rrd",
    log:
        f"results/logs/record_trials/{CELL_ITEM}.log",
    benchmark:
        f"results/benchmarks/record_trials/{CELL_ITEM}.jsonl"
    wildcard_constraints:
        object=one_of(names("object")),
        background=one_of(names("background")),
        renderer="gs|mesh|mesh_vertex",
        variant=one_of(config["variants"]),
    conda:
        "../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        code=script_digest("record_trials"),
        worlds=shown_worlds,
        seeds=shown_seeds,
    message:
        "Record the trials: {wildcards.task} {wildcards.object} on {wildcards.background}, {wildcards.renderer}, {wildcards.variant}"
    script:
        "../scripts/record_trials.py"


rule trial_pictures:
    input:
        trial_pictures,
    localrule: True
