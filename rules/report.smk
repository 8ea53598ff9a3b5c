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
        code=code_digest("gsbridge.report.rendering_table"),
        scenes=scene_labels(),
        films=film_records(),
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
        code=code_digest("gsbridge.report.figures"),
        scenes=lambda wildcards: scenes_from(wildcards.origin),
    message:
        "Draw photo, soft, GaMeS and refined of the {wildcards.origin} scenes side by side"
    script:
        "../scripts/compare_renderings.py"


rule assemble_tables:
    input:
        rendering="results/rows/rendering.csv",
        timing="results/rows/timing.csv",
        figures=comparison_figures,
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
        code=code_digest("gsbridge.report.tables"),
        preset=config["preset"],
    message:
        "Assemble the tables"
    script:
        "../scripts/assemble_tables.py"
