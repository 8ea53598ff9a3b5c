rule generate_gap_cases:
    input:
        photos=lambda wildcards: BENCHMARK.contents(wildcards.tier, "photos"),
        renders=lambda wildcards: BENCHMARK.contents(wildcards.tier, "renders"),
    output:
        cases=directory("results/gap-benchmark/{tier}/cases"),
        # Hashed in the cases' manifest before any diagnosis begins; read by the scoring rule alone.
        truths=directory("results/truth/gap/{tier}"),
    log:
        "results/logs/generate_gap_cases/{tier}.log",
    benchmark:
        "results/benchmarks/generate_gap_cases/{tier}.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="60m",
    params:
        code=script_digest("generate_gap_cases"),
        split=GAP["split"],
        cases_wanted=lambda wildcards: GAP["benchmark"][wildcards.tier],
        seal=SEAL,
        seed=SEED,
    message:
        "Hide effects: the {params.split} cases of tier {wildcards.tier}"
    script:
        "../scripts/generate_gap_cases.py"


# Each kind of case has a rule of its own: an edit of how one kind is diagnosed leaves the findings about the others.


rule diagnose_joint_cases:
    input:
        cases="results/gap-benchmark/{tier}/cases",
    output:
        findings=directory("results/gap-benchmark/{tier}/findings/{method}-{chunk}"),
    log:
        "results/logs/diagnose_joint_cases/{tier}-{method}-{chunk}.log",
    benchmark:
        "results/benchmarks/diagnose_joint_cases/{tier}-{method}-{chunk}.jsonl"
    wildcard_constraints:
        tier=one_of(BENCHMARK.tiers("joint")),
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="4h",
    params:
        code=script_digest("diagnose_joint_cases"),
        chunks=GAP["chunks"],
        bank=GAP_BANK,
        state=lambda wildcards: state_folder("diagnose_joint_cases", wildcards, SEED),
        seed=SEED,
    message:
        "Diagnose tier {wildcards.tier} by {wildcards.method}, chunk {wildcards.chunk} of {params.chunks}"
    script:
        "../scripts/diagnose_joint_cases.py"


rule diagnose_thrown_cases:
    input:
        cases="results/gap-benchmark/{tier}/cases",
    output:
        findings=directory("results/gap-benchmark/{tier}/findings/{method}-{chunk}"),
    log:
        "results/logs/diagnose_thrown_cases/{tier}-{method}-{chunk}.log",
    benchmark:
        "results/benchmarks/diagnose_thrown_cases/{tier}-{method}-{chunk}.jsonl"
    wildcard_constraints:
        tier=one_of(BENCHMARK.tiers("thrown")),
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="4h",
    params:
        code=script_digest("diagnose_thrown_cases"),
        chunks=GAP["chunks"],
        bank=GAP_BANK,
        state=lambda wildcards: state_folder("diagnose_thrown_cases", wildcards, SEED),
        seed=SEED,
    message:
        "Diagnose tier {wildcards.tier} by {wildcards.method}, chunk {wildcards.chunk} of {params.chunks}"
    script:
        "../scripts/diagnose_thrown_cases.py"


rule diagnose_photo_cases:
    input:
        cases="results/gap-benchmark/{tier}/cases",
    output:
        findings=directory("results/gap-benchmark/{tier}/findings/{method}-{chunk}"),
    log:
        "results/logs/diagnose_photo_cases/{tier}-{method}-{chunk}.log",
    benchmark:
        "results/benchmarks/diagnose_photo_cases/{tier}-{method}-{chunk}.jsonl"
    wildcard_constraints:
        tier=one_of(BENCHMARK.tiers("photo")),
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="4h",
    params:
        code=script_digest("diagnose_photo_cases"),
        chunks=GAP["chunks"],
        bank=GAP_BANK,
        state=lambda wildcards: state_folder("diagnose_photo_cases", wildcards, SEED),
        seed=SEED,
    message:
        "Diagnose tier {wildcards.tier} by {wildcards.method}, chunk {wildcards.chunk} of {params.chunks}"
    script:
        "../scripts/diagnose_photo_cases.py"


rule score_gap_cases:
    input:
        cases="results/gap-benchmark/{tier}/cases",
        truths="results/truth/gap/{tier}",
        findings=lambda wildcards: BENCHMARK.findings(wildcards.tier, wildcards.scores),
    output:
        scores="results/gap-benchmark/{tier}/{scores}.json",
    log:
        "results/logs/score_gap_cases/{tier}-{scores}.log",
    benchmark:
        "results/benchmarks/score_gap_cases/{tier}-{scores}.jsonl"
    # Of this package alone, or beside all other ways of naming.
    wildcard_constraints:
        scores="scores|compared",
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_gap_cases"),
        methods=lambda wildcards: BENCHMARK.scored(wildcards.tier, wildcards.scores),
        chunks=GAP["chunks"],
    message:
        "Score the findings of tier {wildcards.tier} against what was hidden"
    script:
        "../scripts/score_gap_cases.py"


rule report_gap_benchmark:
    input:
        **BENCHMARK.real_logs,
        floors=project_file("benchmarks/floors.yaml"),
        scores=BENCHMARK.shown,
    output:
        page=report(
            "results/gap-benchmark/report.html",
            caption="captions/gap_benchmark.rst",
            category="Gap",
            labels={"result": "blind benchmark", "of": "hidden effects"},
        ),
    log:
        "results/logs/report_gap_benchmark.log",
    benchmark:
        "results/benchmarks/report_gap_benchmark/all.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("report_gap_benchmark"),
        preset=config["preset"],
    message:
        "Write the page of the blind benchmark"
    script:
        "../scripts/report_gap_benchmark.py"


rule diagnose_real_logs:
    output:
        figures="results/benchmarks/gap_measured.json",
    log:
        "results/logs/diagnose_real_logs.log",
    benchmark:
        "results/benchmarks/diagnose_real_logs/all.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="60m",
    params:
        code=code_digest("benchmarks.gap_measured"),
        program=program("gap_measured"),
        measured=os.environ.get("GSBRIDGE_MEASURED", ""),
    message:
        "Diagnose tosses of a real cube and a real pendulum"
    shell:
        "{params.program} --measured {params.measured:q} --only tosses pendulum"
        " --output {output.figures} > {log} 2>&1"


rule diagnose_real_arm:
    output:
        figures="results/benchmarks/gap_so101.json",
    log:
        "results/logs/diagnose_real_arm.log",
    benchmark:
        "results/benchmarks/diagnose_real_arm/all.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="60m",
    params:
        code=code_digest("benchmarks.gap_so101"),
        program=program("gap_so101"),
        measured=os.environ.get("GSBRIDGE_MEASURED", ""),
        robots=os.environ.get("GSBRIDGE_ROBOTS", ""),
    message:
        "Diagnose a real arm from three motions, judge the account on all others"
    shell:
        "{params.program} --measured {params.measured:q} --robots {params.robots:q}"
        " --turns 3 --output {output.figures} > {log} 2>&1"


rule diagnose_mismatched_laws:
    output:
        figures="results/benchmarks/gap_mismatch.json",
    log:
        "results/logs/diagnose_mismatched_laws.log",
    benchmark:
        "results/benchmarks/diagnose_mismatched_laws/all.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="120m",
    params:
        code=code_digest("benchmarks.gap_mismatch"),
        program=program("gap_mismatch"),
        seal=os.environ.get("GSBRIDGE_SEAL", ""),
    message:
        "Diagnose an arm whose truth follows laws of its own (tier T6)"
    shell:
        "{params.program} --output {output.figures} > {log} 2>&1"


rule score_gap:
    input:
        unpack(lambda wildcards: BENCHMARK.figures(wildcards.area)),
        floors=project_file("benchmarks/floors.yaml"),
    output:
        measured="results/scores/measured/{area}.json",
        scores="results/scores/{area}.json",
    log:
        "results/logs/score_gap/{area}.log",
    benchmark:
        "results/benchmarks/score_gap/{area}.jsonl"
    wildcard_constraints:
        area=one_of(BENCHMARK.areas),
    conda:
        "../envs/gap.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("score_gap"),
        behind=lambda wildcards: provenance(wildcards.area, config),
        preset=config["preset"],
    message:
        "Compare {wildcards.area}, of the gap, with the floors"
    script:
        "../scripts/score_gap.py"
