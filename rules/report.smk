rule collect_rendering:
    input:
        splats=PLAN.splat_records,
        records=PLAN.stage_records,
    output:
        rows="results/rows/rendering.csv",
    log:
        "results/logs/collect_rendering.log",
    benchmark:
        "results/benchmarks/collect_rendering/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_rendering"),
        scenes=PLAN.labels,
        films={scene: f"results/films/{scene}/film.json" for scene in PLAN.mirrored},
    message:
        "Collect the rendering table"
    script:
        "../scripts/collect_rendering.py"


rule collect_timing:
    input:
        rows="results/rows/rendering.csv",
        policies=rows_of(TABLES.rows),
    output:
        rows="results/rows/timing.csv",
    log:
        "results/logs/collect_timing.log",
    benchmark:
        "results/benchmarks/collect_timing/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_timing"),
        benchmarks="results/benchmarks",
    message:
        "Collect the time of each stage"
    script:
        "../scripts/collect_timing.py"


rule compare_renderings:
    input:
        splats=lambda wildcards: collect(
            "results/scenes/{scene}/splats/{binding}/splats.json",
            scene=PLAN.scenes_from(wildcards.origin),
            binding=BINDINGS[:3],
        ),
    output:
        figure=report(
            "results/figures/rendering_comparison_{origin}.png",
            caption="captions/rendering_comparison.rst",
            category="Scenes",
            labels={
                "result": "photo, soft, GaMeS, refined, difference",
                "of": "{origin} scenes",
            },
        ),
    log:
        "results/logs/compare_renderings/{origin}.log",
    benchmark:
        "results/benchmarks/compare_renderings/{origin}.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("compare_renderings"),
        scenes=lambda wildcards: PLAN.scenes_from(wildcards.origin),
    message:
        "Draw photo, soft, GaMeS and refined of the {wildcards.origin} scenes side by side"
    script:
        "../scripts/compare_renderings.py"


rule collect_success:
    input:
        trials=lambda wildcards: TABLES.table_trials(wildcards.table, "csv"),
        trial_records=lambda wildcards: TABLES.table_trials(wildcards.table, "json"),
        robot=lambda wildcards: list(
            TABLES.table_robot_trials(wildcards.table).values()
        ),
        policies=lambda wildcards: TABLES.table_trainings(wildcards.table),
        records=lambda wildcards: TABLES.table_scenes(wildcards.table),
    output:
        rows=kept("results/rows/{table}.csv"),
    log:
        "results/logs/collect_success/{table}.log",
    benchmark:
        "results/benchmarks/collect_success/{table}.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_success"),
        robot=lambda wildcards: TABLES.table_robot_trials(wildcards.table),
        listing=lambda wildcards: GIVEN.trials(
            wildcards.table, TABLES.table_robot_trials(wildcards.table).values()
        ),
    message:
        "Collect the successes: {wildcards.table}"
    script:
        "../scripts/collect_success.py"


rule collect_failures:
    input:
        trials=TABLES.trials(TABLES.policies, TABLES.worlds, "csv"),
        trial_records=TABLES.trials(TABLES.policies, TABLES.worlds, "json"),
        robot=list(TABLES.robot_trials(TABLES.policies).values()),
    output:
        rows=kept("results/rows/failures.csv"),
    log:
        "results/logs/collect_failures.log",
    benchmark:
        "results/benchmarks/collect_failures/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_failures"),
        robot=TABLES.robot_trials(TABLES.policies),
        listing=GIVEN.trials("all", TABLES.robot_trials(TABLES.policies).values()),
    message:
        "Collect how trials ended"
    script:
        "../scripts/collect_failures.py"


rule collect_training:
    input:
        policies=policy_files(TABLES.policies, TABLES.seeds, "training.json"),
        curves=policy_files(TABLES.policies, TABLES.seeds, "training.csv"),
    output:
        rows="results/rows/training.csv",
    log:
        "results/logs/collect_training.log",
    benchmark:
        "results/benchmarks/collect_training/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_training"),
    message:
        "Collect what the trainings took and reached"
    script:
        "../scripts/collect_training.py"


rule draw_learning_curves:
    input:
        curves=policy_files(TABLES.policies, TABLES.seeds, "training.csv"),
    output:
        figure=report(
            "results/figures/learning_curves.png",
            caption="captions/learning_curves.rst",
            category="Policies",
            labels={"result": "learning curves", "of": "every cell"},
        ),
    log:
        "results/logs/draw_learning_curves.log",
    benchmark:
        "results/benchmarks/draw_learning_curves/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("draw_learning_curves"),
    message:
        "Draw the learning curves"
    script:
        "../scripts/draw_learning_curves.py"


rule draw_success:
    input:
        rows=collect("results/rows/{table}.csv", table=TABLES.successes),
    output:
        figure=report(
            "results/figures/success_rates.png",
            caption="captions/success_rates.rst",
            category="Policies",
            labels={"result": "success in both worlds", "of": "every cell"},
        ),
    log:
        "results/logs/draw_success.log",
    benchmark:
        "results/benchmarks/draw_success/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("draw_success"),
    message:
        "Draw the success of every cell in both worlds"
    script:
        "../scripts/draw_success.py"


rule report_scene:
    input:
        records=scene_records,
    output:
        report=report(
            "results/scenes/{scene}/report.html",
            caption="captions/scene.rst",
            category="Scenes",
            labels={"result": "photos, masks, mesh and splats", "of": "{scene}"},
        ),
    log:
        "results/logs/report_scene/{scene}.log",
    benchmark:
        "results/benchmarks/report_scene/{scene}.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("report_scene"),
        folder=lambda wildcards: f"results/scenes/{wildcards.scene}",
    message:
        "Write the page of {wildcards.scene}"
    script:
        "../scripts/report_scene.py"


rule assemble_tables:
    input:
        pages=collect("results/scenes/{scene}/report.html", scene=PLAN.scenes),
        rendering="results/rows/rendering.csv",
        timing="results/rows/timing.csv",
        policies=rows_of(TABLES.rows),
        figures=[
            f"results/figures/rendering_comparison_{origin}.png"
            for origin in ("mirror", "real")
            if PLAN.scenes_from(origin)
        ],
        policy_figures=[f"results/figures/{name}.png" for name in TABLES.figures],
        films=list(TABLES.films.values()),
        records=PLAN.stage_records
        + [f"results/scenes/{scene}/asset/asset.json" for scene in PLAN.bundled],
    output:
        tables=directory("results/tables"),
        # The page of that folder once more: a folder would force snakemake's report into a zip file.
        page=report(
            "results/tables.html",
            caption="captions/tables.rst",
            category="All tables",
            labels={"result": "all tables", "of": "every scene and cell"},
        ),
    log:
        "results/logs/assemble_tables.log",
    benchmark:
        "results/benchmarks/assemble_tables/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("assemble_tables"),
        preset=config["preset"],
        films=list(TABLES.films),
    message:
        "Assemble the tables"
    script:
        "../scripts/assemble_tables.py"
