rule study:
    input:
        "results/study.md",
        [f"results/{table}.md" for table in TABLES.world_variants],
        "results/gap-benchmark/report.html",
        rows_of(sorted({loop["table"] for loop in closed_loops(LOOP, PICTURE_GAP)})),
    localrule: True


rule collect_study:
    input:
        trainings=TABLES.study_files("training.json", trials=False),
        trials=TABLES.study_files("csv", trials=True),
    output:
        rows="results/rows/study.csv",
        page="results/study.md",
    log:
        "results/logs/collect_study.log",
    benchmark:
        "results/benchmarks/collect_study/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_study"),
    message:
        "Compare the ways of learning"
    script:
        "../scripts/collect_study.py"


rule write_world_variants:
    input:
        rows="results/rows/{table}.csv",
    output:
        page="results/{table}.md",
    log:
        "results/logs/write_world_variants/{table}.log",
    benchmark:
        "results/benchmarks/write_world_variants/{table}.jsonl"
    wildcard_constraints:
        table="worlds|picture_gap",
    localrule: True
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("write_world_variants"),
    message:
        "Compare policies in further worlds: {wildcards.table}"
    script:
        "../scripts/write_world_variants.py"


rule collect_severity:
    input:
        trials=[source["file"] for source in SEVERITY.controller],
    output:
        rows="results/rows/severity_controller.csv",
        page="results/severity_controller.md",
    log:
        "results/logs/collect_severity.log",
    benchmark:
        "results/benchmarks/collect_severity/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_severity"),
        sources=SEVERITY.controller,
    message:
        "Compare the controller's successes at different severities"
    script:
        "../scripts/collect_severity.py"


rule collect_severity_cells:
    input:
        trials=SEVERITY.trials("severity", "csv"),
        trial_records=SEVERITY.trials("severity", "json"),
        policies=SEVERITY.trainings("severity"),
        records=SEVERITY.scenes("severity"),
    output:
        rows="results/rows/severity.csv",
        page="results/severity.md",
    log:
        "results/logs/collect_severity_cells.log",
    benchmark:
        "results/benchmarks/collect_severity_cells/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_severity_cells"),
        severities=SEVERITY.levels,
    message:
        "Compare the policies of the tables at different severities"
    script:
        "../scripts/collect_severity_cells.py"


rule collect_worth:
    input:
        trials=lambda wildcards: SEVERITY.trials(wildcards.who, "csv"),
        trial_records=lambda wildcards: SEVERITY.trials(wildcards.who, "json"),
        policies=lambda wildcards: SEVERITY.trainings(wildcards.who),
        records=lambda wildcards: SEVERITY.scenes(wildcards.who),
    output:
        rows="results/rows/{who}.csv",
        page="results/{who}.md",
        figure="results/figures/{who}.png",
    log:
        "results/logs/collect_worth/{who}.log",
    benchmark:
        "results/benchmarks/collect_worth/{who}.jsonl"
    wildcard_constraints:
        who="worth|graded",
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_worth"),
        severities=SEVERITY.levels,
    message:
        "Compare policies at different severities: {wildcards.who}"
    script:
        "../scripts/collect_worth.py"
