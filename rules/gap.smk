rule gap:
    input:
        collect(
            ["results/gap/{case}/report.html", "results/rerun/gap/{case}.rrd"],
            case=list(GAP_CASES),
        ),
        "results/rows/gap.csv",
    localrule: True


rule read_gap_records:
    input:
        case=gap_case,
        files=gap_case_files,
    output:
        data=kept("results/gap/{case}/records.npz"),
        record=kept("results/gap/{case}/records.json"),
    log:
        "results/logs/read_gap_records/{case}.log",
    benchmark:
        "results/benchmarks/read_gap_records/{case}.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("read_gap_records"),
        listing=lambda wildcards: GIVEN.case(
            wildcards.case, gap_case(wildcards), gap_case_files(wildcards)
        ),
    message:
        "Read and check the records of {wildcards.case}"
    script:
        "../scripts/read_gap_records.py"


rule compare_gap:
    input:
        model=gap_model,
        data="results/gap/{case}/records.npz",
        record="results/gap/{case}/records.json",
    output:
        comparison="results/gap/{case}/comparison.json",
    log:
        "results/logs/compare_gap/{case}.log",
    benchmark:
        "results/benchmarks/compare_gap/{case}.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("compare_gap"),
    message:
        "Replay the records of {wildcards.case} through its model"
    script:
        "../scripts/compare_gap.py"


rule screen_gap:
    input:
        model=gap_model,
        data="results/gap/{case}/records.npz",
        record="results/gap/{case}/records.json",
    output:
        screening="results/gap/{case}/screen.json",
    log:
        "results/logs/screen_gap/{case}.log",
    benchmark:
        "results/benchmarks/screen_gap/{case}.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="60m",
    params:
        code=script_digest("screen_gap"),
        bank=GAP_BANK,
    message:
        "Simulate what each known effect would change in the records of {wildcards.case}"
    script:
        "../scripts/screen_gap.py"


rule identify_gap:
    input:
        model=gap_model,
        data="results/gap/{case}/records.npz",
        record="results/gap/{case}/records.json",
        # The bank is there when this is.
        screening="results/gap/{case}/screen.json",
    output:
        findings="results/gap/{case}/findings.json",
        model="results/gap/{case}/model.yaml",
    log:
        "results/logs/identify_gap/{case}.log",
    benchmark:
        "results/benchmarks/identify_gap/{case}.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="60m",
    params:
        code=script_digest("identify_gap"),
        bank=GAP_BANK,
        seed=SEED,
    message:
        "Find what the model of {wildcards.case} lacks"
    script:
        "../scripts/identify_gap.py"


rule amend_object:
    input:
        nominal=project_file("models/nominal.yaml"),
        findings="results/gap/{case}/findings.json",
    output:
        model="results/gap/{case}/simulation.yaml",
    log:
        "results/logs/amend_object/{case}.log",
    benchmark:
        "results/benchmarks/amend_object/{case}.jsonl"
    conda:
        "../envs/gap.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("amend_object"),
    message:
        "Put what the throws of {wildcards.case} showed into the simulation's model"
    script:
        "../scripts/amend_object.py"


rule replay_gap:
    input:
        model=gap_model,
        data="results/gap/{case}/records.npz",
        record="results/gap/{case}/records.json",
        findings="results/gap/{case}/findings.json",
    output:
        series="results/gap/{case}/replays.npz",
        replays="results/gap/{case}/replays.json",
    log:
        "results/logs/replay_gap/{case}.log",
    benchmark:
        "results/benchmarks/replay_gap/{case}.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("replay_gap"),
    message:
        "Replay the records of {wildcards.case} before and after"
    script:
        "../scripts/replay_gap.py"


rule report_gap:
    input:
        record="results/gap/{case}/records.json",
        comparison="results/gap/{case}/comparison.json",
        screening="results/gap/{case}/screen.json",
        findings="results/gap/{case}/findings.json",
        series="results/gap/{case}/replays.npz",
        replays="results/gap/{case}/replays.json",
    output:
        page=report(
            "results/gap/{case}/report.html",
            caption="captions/gap.rst",
            category="Gap",
            labels={"result": "what the model lacks", "of": "{case}"},
        ),
    log:
        "results/logs/report_gap/{case}.log",
    benchmark:
        "results/benchmarks/report_gap/{case}.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("report_gap"),
    message:
        "Write the report of {wildcards.case}"
    script:
        "../scripts/report_gap.py"


rule record_gap:
    input:
        model=gap_model,
        files=gap_case_files,
        record="results/gap/{case}/records.json",
        findings="results/gap/{case}/findings.json",
        series="results/gap/{case}/replays.npz",
        replays="results/gap/{case}/replays.json",
    output:
        recording="results/rerun/gap/{case}.rrd",
    log:
        "results/logs/record_gap/{case}.log",
    benchmark:
        "results/benchmarks/record_gap/{case}.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("record_gap"),
    message:
        "Record {wildcards.case}: measured, nominal and explained motion side by side"
    script:
        "../scripts/record_gap.py"


rule collect_gap:
    input:
        findings=collect("results/gap/{case}/findings.json", case=list(GAP_CASES)),
    output:
        rows="results/rows/gap.csv",
    log:
        "results/logs/collect_gap.log",
    benchmark:
        "results/benchmarks/collect_gap/all.jsonl"
    conda:
        "../envs/gap.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_gap"),
        cases=list(GAP_CASES),
    message:
        "Collect the cases of the gap"
    script:
        "../scripts/collect_gap.py"
