rule collect_rendering:
    input:
        splats=splat_records,
        masks=collect(
            "results/scenes/{scene}/masks/masks.json", scene=preset_scenes("object")
        ),
    output:
        rows="results/rows/rendering.csv",
    log:
        "results/logs/collect_rendering.log",
    benchmark:
        "results/benchmarks/collect_rendering/all.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=code_digest("gsbridge.report.rendering_table"),
        scenes=scene_labels(),
    message:
        "Collect the rendering table"
    script:
        "../scripts/collect_rendering.py"


rule collect_timing:
    input:
        rows="results/rows/rendering.csv",
    output:
        rows="results/rows/timing.csv",
    log:
        "results/logs/collect_timing.log",
    conda:
        "../envs/report.yaml"
    params:
        code=code_digest("gsbridge.report.timing_table"),
        benchmarks="results/benchmarks",
    message:
        "Collect the time of each stage"
    script:
        "../scripts/collect_timing.py"


rule compare_renderings:
    input:
        rows="results/rows/rendering.csv",
        splats=collect(
            "results/scenes/{scene}/splats/{binding}/splats.json",
            scene=SCENES,
            binding=["games", "soft", "refined"],
        ),
    output:
        figure=report(
            "results/figures/rendering_comparison.png",
            caption="captions/rendering_comparison.rst",
            category="Rendering",
            labels={"figure": "photo, soft, GaMeS, difference"},
        ),
    log:
        "results/logs/compare_renderings.log",
    benchmark:
        "results/benchmarks/compare_renderings/all.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=code_digest("gsbridge.report.figures"),
        scenes=SCENES,
    message:
        "Draw photo, soft, GaMeS and refined side by side"
    script:
        "../scripts/compare_renderings.py"


rule assemble_tables:
    input:
        rendering="results/rows/rendering.csv",
        timing="results/rows/timing.csv",
        figure="results/figures/rendering_comparison.png",
        records=stage_records,
    output:
        tables=report(
            directory("results/tables"),
            caption="captions/tables.rst",
            category="Tables",
            htmlindex="index.html",
        ),
    log:
        "results/logs/assemble_tables.log",
    benchmark:
        "results/benchmarks/assemble_tables/all.jsonl"
    conda:
        "../envs/report.yaml"
    params:
        code=code_digest("gsbridge.report.tables"),
        preset=config["preset"],
    message:
        "Assemble the tables"
    script:
        "../scripts/assemble_tables.py"
