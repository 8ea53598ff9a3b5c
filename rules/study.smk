rule study:
    input:
        "results/rows/study.csv",
        "results/gap-benchmark/report.html",
        loop_rows,
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
        code=code_digest("gsbridge.report.study"),
    message:
        "Compare the ways of learning"
    script:
        "../scripts/collect_study.py"
