rule study:
    input:
        "results/study.md",
        further_pages,
        "results/gap-benchmark/report.html",
        loop_rows,
        sight_loop_rows,
    localrule: True


rule collect_study:
    input:
        trainings=study_files("policies", "training.json"),
        trials=study_files("trials", "csv"),
    output:
        rows="results/rows/study.csv",
        page="results/study.md",
    log:
        "results/logs/collect_study.log",
    conda:
        "../envs/report.yaml"
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
