rule collect_rendering:
    input:
        splats=splat_records,
        records=stage_records,
    output:
        rows="results/rows/rendering.csv",
    log:
        "results/logs/collect_rendering.log",
    benchmark:
        "results/benchmarks/collect_rendering/all.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("collect_rendering"),
        scenes=scene_labels(),
        films=film_records(),
    message:
        "Collect the rendering table"
    script:
        "../scripts/collect_rendering.py"


rule collect_timing:
    input:
        rows="results/rows/rendering.csv",
        policies=policy_rows,
    output:
        rows="results/rows/timing.csv",
    log:
        "results/logs/collect_timing.log",
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("collect_timing"),
        benchmarks="results/benchmarks",
    message:
        "Collect the time of each stage"
    script:
        "../scripts/collect_timing.py"


rule compare_renderings:
    input:
        splats=compared_splats,
    output:
        figure=report(
            "results/figures/rendering_comparison_{origin}.png",
            caption="captions/rendering_comparison.rst",
            category="Rendering",
            labels={
                "figure": "photo, soft, GaMeS, refined, difference",
                "scenes": "{origin}",
            },
        ),
    log:
        "results/logs/compare_renderings/{origin}.log",
    benchmark:
        "results/benchmarks/compare_renderings/{origin}.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("compare_renderings"),
        scenes=lambda wildcards: scenes_from(wildcards.origin),
    message:
        "Draw photo, soft, GaMeS and refined of the {wildcards.origin} scenes side by side"
    script:
        "../scripts/compare_renderings.py"


rule collect_success:
    input:
        trials=table_trials,
        trial_records=table_trial_records,
        robot=table_robot_files,
        policies=table_policies,
        records=table_records,
    output:
        rows="results/rows/{table}.csv",
    log:
        "results/logs/collect_success/{table}.log",
    benchmark:
        "results/benchmarks/collect_success/{table}.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("collect_success"),
        robot=table_robot_trials,
    message:
        "Collect the successes: {wildcards.table}"
    script:
        "../scripts/collect_success.py"


rule collect_failures:
    input:
        trials=policy_trials(POLICIES, "csv"),
        trial_records=policy_trials(POLICIES, "json"),
        robot=list(robot_trials(POLICIES).values()),
    output:
        rows="results/rows/failures.csv",
    log:
        "results/logs/collect_failures.log",
    benchmark:
        "results/benchmarks/collect_failures/all.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("collect_failures"),
        robot=robot_trials(POLICIES),
    message:
        "Collect how trials ended"
    script:
        "../scripts/collect_failures.py"


rule collect_training:
    input:
        policies=policy_files(POLICIES, "training.json"),
        curves=policy_files(POLICIES, "training.csv"),
    output:
        rows="results/rows/training.csv",
    log:
        "results/logs/collect_training.log",
    benchmark:
        "results/benchmarks/collect_training/all.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("collect_training"),
    message:
        "Collect what the trainings took and reached"
    script:
        "../scripts/collect_training.py"


rule draw_learning_curves:
    input:
        curves=policy_files(POLICIES, "training.csv"),
    output:
        figure=report(
            "results/figures/learning_curves.png",
            caption="captions/learning_curves.rst",
            category="Policies",
            labels={"figure": "learning curves"},
        ),
    log:
        "results/logs/draw_learning_curves.log",
    benchmark:
        "results/benchmarks/draw_learning_curves/all.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("draw_learning_curves"),
    message:
        "Draw the learning curves"
    script:
        "../scripts/draw_learning_curves.py"


rule draw_success:
    input:
        rows=collect("results/rows/{table}.csv", table=success_tables()),
    output:
        figure=report(
            "results/figures/success_rates.png",
            caption="captions/success_rates.rst",
            category="Policies",
            labels={"figure": "success in both worlds"},
        ),
    log:
        "results/logs/draw_success.log",
    benchmark:
        "results/benchmarks/draw_success/all.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("draw_success"),
    message:
        "Draw the success of every cell in both worlds"
    script:
        "../scripts/draw_success.py"


rule assemble_tables:
    input:
        rendering="results/rows/rendering.csv",
        timing="results/rows/timing.csv",
        policies=policy_rows,
        figures=comparison_figures,
        policy_figures=policy_figures,
        films=list(trial_films().values()),
        records=page_records,
    output:
        # Not marked for snakemake's report: a folder would force the report into a zip file.
        tables=directory("results/tables"),
    log:
        "results/logs/assemble_tables.log",
    benchmark:
        "results/benchmarks/assemble_tables/all.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("assemble_tables"),
        preset=config["preset"],
        films=list(trial_films()),
    message:
        "Assemble the tables"
    script:
        "../scripts/assemble_tables.py"
