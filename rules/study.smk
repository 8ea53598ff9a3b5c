rule study:
    input:
        "results/study.md",
        [f"results/{table}.md" for table in TABLES.further],
        "results/gap-benchmark/report.html",
        rows_of(sorted({loop["table"] for loop in closed_loops(LOOP, SIGHT)})),
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


rule write_further:
    input:
        rows="results/rows/{table}.csv",
    output:
        page="results/{table}.md",
    log:
        "results/logs/write_further/{table}.log",
    benchmark:
        "results/benchmarks/write_further/{table}.jsonl"
    wildcard_constraints:
        table="worlds|sight",
    localrule: True
    conda:
        "../envs/report.yaml"
    params:
        code=script_digest("write_further"),
    message:
        "Compare policies in further worlds: {wildcards.table}"
    script:
        "../scripts/write_further.py"


rule collect_severity:
    input:
        trials=lambda wildcards: SEVERITY.files(wildcards.who),
    output:
        rows="results/rows/severity_{who}.csv",
        page="results/severity_{who}.md",
    log:
        "results/logs/collect_severity/{who}.log",
    benchmark:
        "results/benchmarks/collect_severity/{who}.jsonl"
    wildcard_constraints:
        who="controller|policies",
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_severity"),
        sources=lambda wildcards: SEVERITY.sources(wildcards.who),
    message:
        "Compare successes at different severities: {wildcards.who}"
    script:
        "../scripts/collect_severity.py"
