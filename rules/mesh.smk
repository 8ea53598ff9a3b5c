rule mesh_object:
    input:
        masks="results/scenes/{scene}/masks/masks.json",
        mask_images="results/scenes/{scene}/masks/images",
        views="results/scenes/{scene}/align/views.json",
        points="results/scenes/{scene}/align/points.npz",
        images="results/scenes/{scene}/sfm/images",
    output:
        visual=kept("results/scenes/{scene}/mesh/visual.ply"),
        collision=kept("results/scenes/{scene}/mesh/collision.ply"),
        mesh=kept("results/scenes/{scene}/mesh/mesh.json"),
    log:
        "results/logs/mesh_object/{scene}.log",
    benchmark:
        "results/benchmarks/mesh_object/{scene}.jsonl"
    wildcard_constraints:
        scene=one_of(OBJECTS),
    conda:
        "../envs/mesh.yaml"
    threads: SCENE_THREADS
    resources:
        mem_mb=4000,
        runtime="30m",
    params:
        code=script_digest("mesh_object"),
        settings=settings("mesh"),
        seed=SEED,
    message:
        "Mesh the object of {wildcards.scene}"
    script:
        "../scripts/mesh_object.py"


rule mesh_background:
    input:
        align="results/scenes/{scene}/align/align.json",
        views="results/scenes/{scene}/align/views.json",
        points="results/scenes/{scene}/align/points.npz",
        images="results/scenes/{scene}/sfm/images",
    output:
        visual=kept("results/scenes/{scene}/mesh/visual.ply"),
        collision=kept("results/scenes/{scene}/mesh/collision.ply"),
        mesh=kept("results/scenes/{scene}/mesh/mesh.json"),
    log:
        "results/logs/mesh_background/{scene}.log",
    benchmark:
        "results/benchmarks/mesh_background/{scene}.jsonl"
    wildcard_constraints:
        scene=one_of(BACKGROUNDS),
    conda:
        "../envs/mesh.yaml"
    threads: SCENE_THREADS
    resources:
        mem_mb=4000,
        runtime="30m",
    params:
        code=script_digest("mesh_background"),
        settings=settings("mesh"),
        seed=SEED,
    message:
        "Mesh the table of {wildcards.scene}"
    script:
        "../scripts/mesh_background.py"
