rule film_scene:
    output:
        frames=directory("results/films/{scene}/frames"),
        film="results/films/{scene}/film.json",
        truth=directory("results/truth/{scene}"),
    log:
        "results/logs/film_scene/{scene}.log",
    benchmark:
        "results/benchmarks/film_scene/{scene}.jsonl"
    conda:
        "../envs/mirror.yaml"
    threads: 1
    resources:
        mem_mb=2500,
        runtime="60m",
    params:
        code=script_digest("film_scene"),
        film=lambda wildcards: PLAN.source(wildcards.scene)[1],
        take=lambda wildcards: config["scenes"][wildcards.scene]["take"],
        settings=film_settings,
        seed=SEED,
        state=film_state,
    message:
        "Film {wildcards.scene} in the mirror"
    script:
        "../scripts/film_scene.py"


rule draw_capture_guide:
    output:
        figure="results/figures/capture_guide.jpg",
    log:
        "results/logs/draw_capture_guide.log",
    benchmark:
        "results/benchmarks/draw_capture_guide/all.jsonl"
    conda:
        "../envs/mirror.yaml"
    threads: 1
    resources:
        mem_mb=2500,
        runtime="60m",
    params:
        code=script_digest("draw_capture_guide"),
    message:
        "Photograph good and bad captures for the guide to filming"
    script:
        "../scripts/draw_capture_guide.py"
