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
        scene=one_of(FILMED),
    conda:
        "../envs/report.yaml"
    resources:
        runtime="10m",
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
    benchmark:
        "results/benchmarks/score_keyframes/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
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
    benchmark:
        "results/benchmarks/benchmark_rasterizer/all.jsonl"
    conda:
        "../envs/splats.yaml"
    # Alone on the machine: the figures are times.
    threads: MANY_THREADS
    resources:
        mem_mb=1000,
        runtime="60m",
    params:
        code=code_digest("benchmarks.rasterizer"),
        program=program("rasterizer"),
    message:
        "Time the rasteriser"
    shell:
        "{params.program} --json > {output.benchmark} 2> {log}"


rule score_real2sim:
    input:
        floors=project_file("benchmarks/floors.yaml"),
        scenes=collect("results/scores/scenes/{scene}.json", scene=PLAN.mirrored),
        films=collect("results/films/{scene}/film.json", scene=PLAN.mirrored),
        rendering="results/rows/rendering.csv",
        real=[path for paths in PLAN.real_records.values() for path in paths.values()],
        rasterizer="results/benchmarks/rasterizer.json",
    output:
        measured="results/scores/measured/real2sim.json",
        scores="results/scores/real2sim.json",
    log:
        "results/logs/score_real2sim.log",
    benchmark:
        "results/benchmarks/score_real2sim/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_real2sim"),
        behind=provenance("real2sim", config),
        preset=config["preset"],
        films={
            scene: f"results/films/{scene}/film.json"
            for scene in PLAN.scenes_of("object")
            if scene in FILMED
        },
        real=PLAN.real_records,
    message:
        "Compare what was measured with the floors"
    script:
        "../scripts/score_real2sim.py"


rule score_shapes:
    input:
        floors=project_file("benchmarks/floors.yaml"),
        scenes=collect("results/scores/scenes/{scene}.json", scene=PLAN.shapes),
        longest=[
            path for found in PLAN.longest_sides.values() for path in found.values()
        ],
        trials=[
            path
            for world in ("sim", "mirror")
            for found in PLAN.vessel_trials(world).values()
            for path in found.values()
        ],
    output:
        measured="results/scores/measured/shapes.json",
        longest="results/scores/longest_sides.json",
        scores="results/scores/shapes.json",
    log:
        "results/logs/score_shapes.log",
    benchmark:
        "results/benchmarks/score_shapes/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_shapes"),
        behind=provenance("shapes", config),
        preset=config["preset"],
        takes=[name for name in PLAN.shapes if config["scenes"][name]["take"]],
        longest=PLAN.longest_sides,
        trials={world: PLAN.vessel_trials(world) for world in ("sim", "mirror")},
    message:
        "Compare hollow, wide-footed, see-through and plain things with the floors"
    script:
        "../scripts/score_shapes.py"


rule reconstruct_turned:
    input:
        keyframes="results/scenes/{scene}/capture/keyframes.json",
        frames="results/scenes/{scene}/capture/frames",
        sfm="results/scenes/{scene}/sfm/sfm.json",
        align="results/scenes/{scene}/align/align.json",
        masks="results/scenes/{scene}/masks/masks.json",
        mesh="results/scenes/{scene}/mesh/mesh.json",
        visual="results/scenes/{scene}/mesh/visual.ply",
        collision="results/scenes/{scene}/mesh/collision.ply",
    output:
        record="results/scenes/{scene}/turned/{degrees}.json",
    log:
        "results/logs/reconstruct_turned/{scene}-{degrees}.log",
    benchmark:
        "results/benchmarks/reconstruct_turned/{scene}-{degrees}.jsonl"
    wildcard_constraints:
        scene=one_of(filter(PLAN.may_turn, config["photos"])),
        degrees="0|90|180|270",
    conda:
        "../envs/mesh.yaml"
    threads: SCENE_THREADS
    resources:
        mem_mb=4000,
        runtime="120m",
    params:
        code=script_digest("reconstruct_turned"),
        workspace=lambda wildcards: f"results/.state/reconstruct_turned/{wildcards.scene}-{wildcards.degrees}",
        sfm=settings("sfm"),
        align=settings("align"),
        masks=settings("masks"),
        mesh=settings("mesh"),
        board=lambda wildcards: config["scenes"][wildcards.scene]["board"],
        known_length=lambda wildcards: config["scenes"][wildcards.scene]["known_length"],
        seed=SEED,
    message:
        "Reconstruct {wildcards.scene} from photos turned by {wildcards.degrees} degrees"
    script:
        "../scripts/reconstruct_turned.py"


rule score_photos:
    input:
        floors=project_file("benchmarks/floors.yaml"),
        references=project_file("benchmarks/photos.json"),
        files=[path for scene in PLAN.photos for path in PLAN.photo_files(scene)],
    output:
        measured="results/scores/measured/photos.json",
        scores="results/scores/photos.json",
    log:
        "results/logs/score_photos.log",
    benchmark:
        "results/benchmarks/score_photos/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_photos"),
        behind=provenance("photos", config),
        preset=config["preset"],
        scenes={scene: PLAN.photo_records(scene) for scene in PLAN.photos},
    message:
        "Compare real things with the floors"
    script:
        "../scripts/score_photos.py"


TOY_ROWS = ROOT / "toy/results/rows/grasping.csv"
WALL_TIMES = "results/benchmarks/wall_times.json"


rule score_policies:
    input:
        floors=project_file("benchmarks/floors.yaml"),
        grasping=measured_rows("grasping"),
        renderer_contrast=measured_rows("renderer_contrast"),
        pick_and_place=measured_rows("pick_and_place"),
        training=measured_rows("training"),
        # Rows of a toy run and wall times of whole runs, where there were any.
        toy=PLAN.portable(TOY_ROWS) if TOY_ROWS.is_file() else [],
        wall_times=WALL_TIMES if Path(WALL_TIMES).is_file() else [],
    output:
        measured="results/scores/measured/policies.json",
        scores="results/scores/policies.json",
    log:
        "results/logs/score_policies.log",
    benchmark:
        "results/benchmarks/score_policies/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_policies"),
        behind=provenance("policies", config),
        preset=config["preset"],
    message:
        "Compare the policies with the floors"
    script:
        "../scripts/score_policies.py"


rule score_worlds:
    input:
        floors=project_file("benchmarks/floors.yaml"),
        worlds="results/rows/worlds.csv",
    output:
        measured="results/scores/measured/worlds.json",
        scores="results/scores/worlds.json",
    log:
        "results/logs/score_worlds.log",
    benchmark:
        "results/benchmarks/score_worlds/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_worlds"),
        behind=provenance("worlds", config),
        preset=config["preset"],
    message:
        "Compare the policies in further worlds with the floors"
    script:
        "../scripts/score_worlds.py"


rule score_severity:
    input:
        floors=project_file("benchmarks/floors.yaml"),
        rows=compared_rows("severity"),
    output:
        measured="results/scores/measured/severity.json",
        scores="results/scores/severity.json",
    log:
        "results/logs/score_severity.log",
    benchmark:
        "results/benchmarks/score_severity/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_severity"),
        behind=provenance("severity", config),
        preset=config["preset"],
    message:
        "Compare the policies of the tables on worse days with the floors"
    script:
        "../scripts/score_severity.py"


rule score_worth:
    input:
        floors=project_file("benchmarks/floors.yaml"),
        worth=compared_rows("worth"),
        graded=compared_rows("graded"),
    output:
        measured="results/scores/measured/worth.json",
        scores="results/scores/worth.json",
    log:
        "results/logs/score_worth.log",
    benchmark:
        "results/benchmarks/score_worth/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_worth"),
        behind=provenance("worth", config),
        preset=config["preset"],
    message:
        "Compare what splats are worth with the floors"
    script:
        "../scripts/score_worth.py"


rule score_study:
    input:
        floors=project_file("benchmarks/floors.yaml"),
        study="results/rows/study.csv",
    output:
        measured="results/scores/measured/study.json",
        scores="results/scores/study.json",
    log:
        "results/logs/score_study.log",
    benchmark:
        "results/benchmarks/score_study/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_study"),
        behind=provenance("study", config),
        preset=config["preset"],
    message:
        "Compare the study with the floors"
    script:
        "../scripts/score_study.py"


rule score_loops:
    input:
        **{
            loop["table"]: f"results/rows/{loop['table']}.csv"
            for loop in closed_loops(LOOP, PICTURE_GAP)
        },
        floors=project_file("benchmarks/floors.yaml"),
    output:
        measured="results/scores/measured/loops.json",
        scores="results/scores/loops.json",
    log:
        "results/logs/score_loops.log",
    benchmark:
        "results/benchmarks/score_loops/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_loops"),
        behind=provenance("loops", config),
        loops=closed_loops(LOOP, PICTURE_GAP),
        preset=config["preset"],
    message:
        "Compare the closed loops with the floors"
    script:
        "../scripts/score_loops.py"


rule record_scores:
    input:
        scores="results/scores/{area}.json",
        evidence=lambda wildcards: EVIDENCE.files(wildcards.area),
    output:
        # Kept with the code: what was measured, at which commit, while results/ comes and goes.
        record="benchmarks/scores/{area}.json",
        evidence=directory("benchmarks/evidence/{area}"),
    log:
        "results/logs/record_scores/{area}.log",
    benchmark:
        "results/benchmarks/record_scores/{area}.jsonl"
    localrule: True
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("record_scores"),
        kinds=lambda wildcards: EVIDENCE.kinds(wildcards.area),
    message:
        "Record the figures of {wildcards.area}, and the rows behind them"
    script:
        "../scripts/record_scores.py"


rule record_timings:
    output:
        timings="benchmarks/evidence/timings.csv.gz",
    log:
        "results/logs/record_timings.log",
    benchmark:
        "results/benchmarks/record_timings/all.jsonl"
    localrule: True
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("record_timings"),
        benchmarks="results/benchmarks",
    message:
        "Record what each job took"
    script:
        "../scripts/record_timings.py"


rule write_results_page:
    input:
        # Areas are measured on different days; those that are not asked for stand as they were recorded last.
        scores=collect("benchmarks/scores/{area}.json", area=config["areas"]),
    output:
        page="benchmarks/RESULTS.md",
    log:
        "results/logs/write_results_page.log",
    benchmark:
        "results/benchmarks/write_results_page/all.jsonl"
    localrule: True
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("write_results_page"),
        behind=provenances(config),
    message:
        "Write the page of results"
    script:
        "../scripts/write_results_page.py"


rule score_scenes:
    input:
        collect("results/scores/scenes/{scene}.json", scene=PLAN.mirrored),
        "results/scores/keyframes.json",
    localrule: True
