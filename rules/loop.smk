rule describe_arm:
    input:
        robot="results/robot/description",
        registration="results/workspace/registration.json",
        model=project_file("models/nominal.yaml"),
    output:
        urdf="results/loop/arm/arm.urdf",
        model="results/loop/arm/nominal.yaml",
    log:
        "results/logs/describe_arm.log",
    benchmark:
        "results/benchmarks/describe_arm/all.jsonl"
    conda:
        "../envs/gap.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("describe_arm"),
    message:
        "Describe the simulated arm as the gap takes it"
    script:
        "../scripts/describe_arm.py"


rule log_trials:
    input:
        table=lambda wildcards: LOOP.trials(wildcards.world, "csv"),
        log=lambda wildcards: LOOP.trials(wildcards.world, "npz"),
        registration="results/workspace/registration.json",
        item=f"results/scenes/{LOOP.cell['object']}/asset/asset.json",
        background=f"results/scenes/{LOOP.cell['background']}/asset/asset.json",
    output:
        fit="results/loop/records/{world}/fit.csv",
        select="results/loop/records/{world}/select.csv",
        verify="results/loop/records/{world}/verify.csv",
        record="results/loop/records/{world}/trials.json",
    log:
        "results/logs/log_trials/{world}.log",
    benchmark:
        "results/benchmarks/log_trials/{world}.jsonl"
    wildcard_constraints:
        world=one_of(config["worlds"]),
    conda:
        "../envs/policy.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime="10m",
    params:
        code=script_digest("log_trials"),
        cell=LOOP.cell,
        world=world_settings,
        sheet=settings("films")["sheet"],
        pieces="results/.state/pieces",
        seed=SEED,
    message:
        "Log the joints in trials of {wildcards.world}"
    script:
        "../scripts/log_trials.py"


rule write_loop_case:
    input:
        unpack(lambda wildcards: LOOP.case(wildcards.case)),
        urdf="results/loop/arm/arm.urdf",
    output:
        case="results/loop/cases/{case}.yaml",
    log:
        "results/logs/write_loop_case/{case}.log",
    benchmark:
        "results/benchmarks/write_loop_case/{case}.jsonl"
    wildcard_constraints:
        case=one_of(LOOP.cases),
    conda:
        "../envs/gap.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("write_loop_case"),
    message:
        "Write the case {wildcards.case}"
    script:
        "../scripts/write_loop_case.py"


rule calibrate_arm:
    input:
        case="results/loop/cases/loop_reference.yaml",
        files=LOOP.case_files("loop_reference"),
    output:
        model="results/loop/arm/calibrated.yaml",
        record="results/loop/arm/calibration.json",
    log:
        "results/logs/calibrate_arm.log",
    benchmark:
        "results/benchmarks/calibrate_arm/all.jsonl"
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime="60m",
    params:
        code=script_digest("calibrate_arm"),
    message:
        "Calibrate the arm's model in the world in which it works"
    script:
        "../scripts/calibrate_arm.py"


rule amend_simulation:
    input:
        nominal=project_file("models/nominal.yaml"),
        arm="results/gap/loop_changed/model.yaml",
        findings="results/gap/loop_changed/findings.json",
        calibration="results/loop/arm/calibration.json",
    output:
        model="results/loop/model.yaml",
        record="results/loop/amendment.json",
    log:
        "results/logs/amend_simulation.log",
    benchmark:
        "results/benchmarks/amend_simulation/all.jsonl"
    conda:
        "../envs/gap.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("amend_simulation"),
    message:
        "Put what was found into the simulation's model"
    script:
        "../scripts/amend_simulation.py"


rule collect_loop:
    input:
        trials=LOOP.tables,
        trainings=LOOP.trainings,
        logged=collect(
            "results/loop/records/{world}/trials.json",
            world=[LOOP.settings["reference"], LOOP.settings["changed"]],
        ),
        calibration="results/loop/arm/calibration.json",
        findings=collect("results/gap/{case}/findings.json", case=list(LOOP.cases)),
        amendment="results/loop/amendment.json",
        # The pages that tell how the findings came about.
        reports=collect("results/gap/{case}/report.html", case=list(LOOP.cases)),
    output:
        rows="results/rows/loop.csv",
        page="results/loop/dynamic.md",
        figure=report(
            "results/figures/loop.png",
            caption="captions/loop.rst",
            category="Gap",
            labels={
                "result": "closing the loop",
                "of": "policies with an amended model",
            },
        ),
    log:
        "results/logs/collect_loop.log",
    benchmark:
        "results/benchmarks/collect_loop/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_loop"),
        plan=LOOP.rows,
        comparisons=LOOP.comparisons,
        cell=LOOP.cell,
    message:
        "Collect the successes before and after, and the price"
    script:
        "../scripts/collect_loop.py"
