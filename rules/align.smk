rule align_scene:
    input:
        keyframes="results/scenes/{scene}/capture/keyframes.json",
        sfm="results/scenes/{scene}/sfm/sfm.json",
        model="results/scenes/{scene}/sfm/model",
        tags="results/scenes/{scene}/sfm/tags.json",
    output:
        align="results/scenes/{scene}/align/align.json",
        views="results/scenes/{scene}/align/views.json",
        points="results/scenes/{scene}/align/points.npz",
    log:
        "results/logs/align_scene/{scene}.log",
    benchmark:
        "results/benchmarks/align_scene/{scene}.jsonl"
    conda:
        "../envs/capture.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=script_digest("align_scene"),
        settings=settings("align"),
        board=lambda wildcards: config["scenes"][wildcards.scene]["board"],
        known_length=lambda wildcards: config["scenes"][wildcards.scene]["known_length"],
        require_scale=lambda wildcards: config["scenes"][wildcards.scene][
            "require_scale"
        ],
        seed=SEED,
    message:
        "Align {wildcards.scene} with its table"
    script:
        "../scripts/align_scene.py"
