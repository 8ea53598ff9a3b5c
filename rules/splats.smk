rule compile_kernels:
    output:
        touch("results/.state/compile_kernels.done"),
    log:
        "results/logs/compile_kernels.log",
    benchmark:
        "results/benchmarks/compile_kernels/all.jsonl"
    conda:
        "../envs/splats.yaml"
    threads: SCENE_THREADS
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=script_digest("compile_kernels"),
        kernels=kernel_digest(),
    message:
        "Compile the rasteriser's kernels once, before jobs run side by side"
    script:
        "../scripts/compile_kernels.py"


rule train_splats:
    input:
        mesh_record="results/scenes/{scene}/mesh/mesh.json",
        mesh="results/scenes/{scene}/mesh/visual.ply",
        masks=scene_masks,
        mask_images=scene_mask_images,
        align="results/scenes/{scene}/align/align.json",
        views="results/scenes/{scene}/align/views.json",
        images="results/scenes/{scene}/sfm/images",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        views=directory("results/scenes/{scene}/splats/{binding}/views"),
        splats="results/scenes/{scene}/splats/{binding}/splats.ply",
        binding="results/scenes/{scene}/splats/{binding}/binding.npz",
        record="results/scenes/{scene}/splats/{binding}/splats.json",
    log:
        "results/logs/train_splats/{scene}-{binding}.log",
    benchmark:
        "results/benchmarks/train_splats/{scene}-{binding}.jsonl"
    conda:
        "../envs/splats.yaml"
    threads: SCENE_THREADS
    resources:
        mem_mb=3000,
        runtime="60m",
        gpu=splat_gpus,
    params:
        code=script_digest("train_splats"),
        settings=splat_settings,
        kind=lambda wildcards: config["scenes"][wildcards.scene]["kind"],
        surface="visual",
        seed=SEED,
        state=training_state,
    message:
        "Train the {wildcards.binding} splats of {wildcards.scene}"
    script:
        "../scripts/train_splats.py"


rule train_by_recipe:
    input:
        mesh_record="results/scenes/{scene}/mesh/mesh.json",
        mesh="results/scenes/{scene}/mesh/visual.ply",
        masks=scene_masks,
        mask_images=scene_mask_images,
        align="results/scenes/{scene}/align/align.json",
        views="results/scenes/{scene}/align/views.json",
        images="results/scenes/{scene}/sfm/images",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        views=directory("results/scenes/{scene}/recipe/{binding}/views"),
        splats="results/scenes/{scene}/recipe/{binding}/splats.ply",
        binding="results/scenes/{scene}/recipe/{binding}/binding.npz",
        record="results/scenes/{scene}/recipe/{binding}/splats.json",
    log:
        "results/logs/train_by_recipe/{scene}-{binding}.log",
    benchmark:
        "results/benchmarks/train_by_recipe/{scene}-{binding}.jsonl"
    wildcard_constraints:
        scene=one_of(PLAN.named("object")),
    conda:
        "../envs/splats.yaml"
    threads: SCENE_THREADS
    resources:
        mem_mb=3000,
        runtime="240m",
        gpu=splat_gpus,
    params:
        code=script_digest("train_by_recipe"),
        settings=lambda wildcards: {**splat_settings(wildcards), **config["recipe"]},
        kind="object",
        surface="visual",
        seed=SEED,
        state=lambda wildcards: state_folder(
            "train_by_recipe",
            wildcards,
            splat_settings(wildcards),
            config["recipe"],
            SEED,
        ),
    message:
        "Train the {wildcards.binding} splats of {wildcards.scene} by the recipe for quality"
    script:
        "../scripts/train_by_recipe.py"


rule train_comparison:
    input:
        mesh_record="results/scenes/{scene}/mesh/mesh.json",
        mesh=comparison_surface,
        masks=scene_masks,
        mask_images=scene_mask_images,
        align="results/scenes/{scene}/align/align.json",
        views="results/scenes/{scene}/align/views.json",
        images="results/scenes/{scene}/sfm/images",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        views=directory(
            "results/scenes/{scene}/comparison/{surface}-{binding}-seed{seed}/views"
        ),
        splats="results/scenes/{scene}/comparison/{surface}-{binding}-seed{seed}/splats.ply",
        binding="results/scenes/{scene}/comparison/{surface}-{binding}-seed{seed}/binding.npz",
        record="results/scenes/{scene}/comparison/{surface}-{binding}-seed{seed}/splats.json",
    log:
        "results/logs/train_comparison/{scene}-{surface}-{binding}-seed{seed}.log",
    benchmark:
        "results/benchmarks/train_comparison/{scene}-{surface}-{binding}-seed{seed}.jsonl"
    conda:
        "../envs/splats.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime="60m",
        gpu=splat_gpus,
    params:
        code=script_digest("train_splats"),
        settings=splat_settings,
        kind=lambda wildcards: config["scenes"][wildcards.scene]["kind"],
        surface=lambda wildcards: wildcards.surface,
        seed=lambda wildcards: int(wildcards.seed),
        state=training_state,
    message:
        "Train the {wildcards.binding} splats of {wildcards.scene} on its {wildcards.surface} mesh, seed {wildcards.seed}"
    script:
        "../scripts/train_splats.py"
