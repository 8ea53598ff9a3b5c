rule score_scene:
    input:
        truth="results/truth/{scene}",
        keyframes="results/scenes/{scene}/capture/keyframes.json",
        sfm="results/scenes/{scene}/sfm/sfm.json",
        align="results/scenes/{scene}/align/align.json",
        views="results/scenes/{scene}/align/views.json",
        masks=scene_masks,
        mask_images=scene_mask_images,
        images="results/scenes/{scene}/sfm/images",
        mesh="results/scenes/{scene}/mesh/mesh.json",
        visual="results/scenes/{scene}/mesh/visual.ply",
        collision="results/scenes/{scene}/mesh/collision.ply",
    output:
        scores="results/scores/scenes/{scene}.json",
    log:
        "results/logs/score_scene/{scene}.log",
    benchmark:
        "results/benchmarks/score_scene/{scene}.jsonl"
    wildcard_constraints:
        scene=one_of(films()),
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=2000,
    params:
        code=script_digest("score_scene"),
        kind=lambda wildcards: config["scenes"][wildcards.scene]["kind"],
        seed=SEED,
    message:
        "Score {wildcards.scene} against the mirror's truth"
    script:
        "../scripts/score_scene.py"


rule score_keyframes:
    input:
        truth="results/truth/dense_pan",
        keyframes="results/scenes/dense_pan/capture/keyframes.json",
    output:
        scores="results/scores/keyframes.json",
    log:
        "results/logs/score_keyframes.log",
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("score_keyframes"),
    message:
        "Score the choice of keyframes on the film whose motion and blur are known"
    script:
        "../scripts/score_keyframes.py"


rule benchmark_rasterizer:
    output:
        benchmark="results/benchmarks/rasterizer.json",
    log:
        "results/logs/benchmark_rasterizer.log",
    conda:
        "../envs/splats.yaml"
    # Alone on the machine: the figures are times.
    threads: workflow.cores
    params:
        code=code_digest("benchmarks.rasterizer"),
        program=program("rasterizer"),
    message:
        "Time the rasteriser"
    shell:
        "{params.program} --json > {output.benchmark} 2> {log}"


rule score_real2sim:
    input:
        # Its date changes with every checkout; its digest below tells whether it changed.
        floors=ancient(f"{workflow.basedir}/benchmarks/floors.yaml"),
        scenes=collect("results/scores/scenes/{scene}.json", scene=mirrored_scenes()),
        films=collect("results/films/{scene}/film.json", scene=mirrored_scenes()),
        rendering="results/rows/rendering.csv",
        real=[path for paths in real_records().values() for path in paths.values()],
        rasterizer="results/benchmarks/rasterizer.json",
    output:
        measured="results/scores/measured/real2sim.json",
        scores="results/scores/real2sim.json",
    log:
        "results/logs/score_real2sim.log",
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("score_real2sim"),
        floors_digest=file_digest("benchmarks/floors.yaml"),
        preset=config["preset"],
        films={
            scene: f"results/films/{scene}/film.json"
            for scene in preset_scenes("object")
            if scene in films()
        },
        real=real_records(),
    message:
        "Compare what was measured with the floors"
    script:
        "../scripts/score_real2sim.py"


rule score_policies:
    input:
        # Its date changes with every checkout; its digest below tells whether it changed.
        floors=ancient(f"{workflow.basedir}/benchmarks/floors.yaml"),
        grasping=measured_rows("grasping"),
        renderer_contrast=measured_rows("renderer_contrast"),
        pick_and_place=measured_rows("pick_and_place"),
        training=measured_rows("training"),
        toy=toy_rows,
        wall_times=wall_times,
    output:
        measured="results/scores/measured/policies.json",
        scores="results/scores/policies.json",
    log:
        "results/logs/score_policies.log",
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("score_policies"),
        floors_digest=file_digest("benchmarks/floors.yaml"),
        preset=config["preset"],
    message:
        "Compare the policies with the floors"
    script:
        "../scripts/score_policies.py"


rule score_worlds:
    input:
        # Its date changes with every checkout; its digest below tells whether it changed.
        floors=ancient(f"{workflow.basedir}/benchmarks/floors.yaml"),
        worlds="results/rows/worlds.csv",
    output:
        measured="results/scores/measured/worlds.json",
        scores="results/scores/worlds.json",
    log:
        "results/logs/score_worlds.log",
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("score_worlds"),
        floors_digest=file_digest("benchmarks/floors.yaml"),
        preset=config["preset"],
    message:
        "Compare the policies in further worlds with the floors"
    script:
        "../scripts/score_worlds.py"


rule score_study:
    input:
        # Its date changes with every checkout; its digest below tells whether it changed.
        floors=ancient(f"{workflow.basedir}/benchmarks/floors.yaml"),
        study="results/rows/study.csv",
    output:
        measured="results/scores/measured/study.json",
        scores="results/scores/study.json",
    log:
        "results/logs/score_study.log",
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("score_study"),
        floors_digest=file_digest("benchmarks/floors.yaml"),
        preset=config["preset"],
    message:
        "Compare the study with the floors"
    script:
        "../scripts/score_study.py"


rule score_loops:
    input:
        unpack(measured_loops),
        # Its date changes with every checkout; its digest below tells whether it changed.
        floors=ancient(f"{workflow.basedir}/benchmarks/floors.yaml"),
    output:
        measured="results/scores/measured/loops.json",
        scores="results/scores/loops.json",
    log:
        "results/logs/score_loops.log",
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("score_loops"),
        floors_digest=file_digest("benchmarks/floors.yaml"),
        loops=closed_loops(),
        preset=config["preset"],
    message:
        "Compare the closed loops with the floors"
    script:
        "../scripts/score_loops.py"


rule record_scores:
    input:
        scores="results/scores/{area}.json",
    output:
        # Kept with the code: what was measured, at which commit, while results/ comes and goes.
        record="benchmarks/scores/{area}.json",
    log:
        "results/logs/record_scores/{area}.log",
    localrule: True
    conda:
        "../envs/report.yaml"
    message:
        "Record the figures of {wildcards.area}"
    shell:
        "cp {input.scores} {output.record}.part 2> {log} && mv {output.record}.part {output.record}"


rule write_results_page:
    input:
        # Areas are measured on different days; those that are not asked for stand as they were recorded last.
        scores=collect("benchmarks/scores/{area}.json", area=config["areas"]),
    output:
        page="benchmarks/RESULTS.md",
    log:
        "results/logs/write_results_page.log",
    localrule: True
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("write_results_page"),
    message:
        "Write the page of results"
    script:
        "../scripts/write_results_page.py"


rule score_scenes:
    input:
        collect("results/scores/scenes/{scene}.json", scene=mirrored_scenes()),
        "results/scores/keyframes.json",
    localrule: True
