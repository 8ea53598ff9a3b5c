rule study:
    input:
        "results/study.md",
        "results/worlds.md",
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


rule write_worlds:
    input:
        rows="results/rows/worlds.csv",
    output:
        page="results/worlds.md",
    log:
        "results/logs/write_worlds.log",
    localrule: True
    conda:
        "../envs/report.yaml"
    params:
        code=code_digest("gsbridge.report.further"),
    message:
        "Compare the policies in further worlds"
    script:
        "../scripts/write_worlds.py"
