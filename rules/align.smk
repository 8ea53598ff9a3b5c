rule measure_length:
    input:
        sfm="results/scenes/{scene}/sfm/sfm.json",
        model="results/scenes/{scene}/sfm/model",
        tags="results/scenes/{scene}/sfm/tags.json",
        images="results/scenes/{scene}/sfm/images",
    output:
        length=kept("results/scenes/{scene}/align/length.json"),
    log:
        "results/logs/measure_length/{scene}.log",
    benchmark:
        "results/benchmarks/measure_length/{scene}.jsonl"
    wildcard_constraints:
        scene=one_of(OBJECTS),
    conda:
        "../envs/mesh.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime="40m",
    params:
        code=script_digest("measure_length"),
        workspace=lambda wildcards: f"results/.state/measure_length/{wildcards.scene}",
        align=settings("align"),
        masks=settings("masks"),
        mesh=settings("mesh"),
        points=lambda wildcards: config["scenes"][wildcards.scene]["masks"]["points"],
        up=lambda wildcards: config["scenes"][wildcards.scene]["up"],
        seed=SEED,
    message:
        "Measure the longest side of the object of {wildcards.scene}"
    script:
        "../scripts/measure_length.py"


rule align_scene:
    input:
        keyframes="results/scenes/{scene}/capture/keyframes.json",
        sfm="results/scenes/{scene}/sfm/sfm.json",
        model="results/scenes/{scene}/sfm/model",
        tags="results/scenes/{scene}/sfm/tags.json",
        length=measured_length,
    output:
        align=kept("results/scenes/{scene}/align/align.json"),
        views=kept("results/scenes/{scene}/align/views.json"),
        points=kept("results/scenes/{scene}/align/points.npz"),
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
        up=lambda wildcards: config["scenes"][wildcards.scene]["up"],
        metres_per_unit=lambda wildcards: config["scenes"][wildcards.scene][
            "metres_per_unit"
        ],
        require_scale=lambda wildcards: config["scenes"][wildcards.scene][
            "require_scale"
        ],
        seed=SEED,
    message:
        "Align {wildcards.scene} with its table"
    script:
        "../scripts/align_scene.py"
