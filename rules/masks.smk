rule segment_object:
    input:
        align="results/scenes/{scene}/align/align.json",
        views="results/scenes/{scene}/align/views.json",
        points="results/scenes/{scene}/align/points.npz",
        images="results/scenes/{scene}/sfm/images",
    output:
        images=kept(directory("results/scenes/{scene}/masks/images")),
        masks=kept("results/scenes/{scene}/masks/masks.json"),
    log:
        "results/logs/segment_object/{scene}.log",
    benchmark:
        "results/benchmarks/segment_object/{scene}.jsonl"
    wildcard_constraints:
        scene=one_of(OBJECTS),
    conda:
        "../envs/mesh.yaml"
    threads: SCENE_THREADS
    resources:
        mem_mb=3000,
        runtime="20m",
    params:
        code=script_digest("segment_object"),
        settings=settings("masks"),
        points=lambda wildcards: config["scenes"][wildcards.scene]["masks"]["points"],
        seed=SEED,
    message:
        "Segment the object of {wildcards.scene}"
    script:
        "../scripts/segment_object.py"
