# What else might have helped where a closed loop helps: the work place is registered and its colours calibrated in the changed
# world, and an amendment of the same size bears a wrong name.


use rule describe_robot as describe_robot_of_world with:
    input:
        registration="results/workspace/worlds/{world}/registration.json",
    output:
        robot=directory("results/workspace/worlds/{world}/description"),
    log:
        "results/logs/describe_robot/{world}.log",
    benchmark:
        "results/benchmarks/describe_robot/{world}.jsonl"
    wildcard_constraints:
        world=one_of(config["worlds"]),
    message:
        "Describe the robot with its camera as registered in {wildcards.world}"


use rule calibrate_wrist_camera as calibrate_wrist_camera_of_world with:
    input:
        registration="results/workspace/worlds/{world}/registration.json",
        robot="results/workspace/worlds/{world}/description",
        capture="results/workspace/worlds/{world}/capture",
        background=workspace_background,
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        record="results/workspace/worlds/{world}/photometry.json",
    log:
        "results/logs/calibrate_wrist_camera/{world}.log",
    benchmark:
        "results/benchmarks/calibrate_wrist_camera/{world}.jsonl"
    wildcard_constraints:
        world=one_of(config["worlds"]),
    message:
        "Measure how the wrist camera sees colours in {wildcards.world}"


use rule fit_robot_splats as fit_robot_splats_of_world with:
    input:
        robot="results/workspace/worlds/{world}/description",
        photometry="results/workspace/worlds/{world}/photometry.json",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        splats=directory("results/workspace/worlds/{world}/splats"),
    log:
        "results/logs/fit_robot_splats/{world}.log",
    benchmark:
        "results/benchmarks/fit_robot_splats/{world}.jsonl"
    wildcard_constraints:
        world=one_of(config["worlds"]),
    message:
        "Fit splats to the links of the robot in the colours of {wildcards.world}"


rule amend_arm_wrongly:
    input:
        nominal=project_file("models/nominal.yaml"),
        arm="results/loop/arm/calibrated.yaml",
        case="results/loop/cases/loop_changed.yaml",
        files=LOOP.case_files("loop_changed"),
        findings="results/gap/loop_changed/findings.json",
    output:
        model="results/loop/wrong_name/model.yaml",
    log:
        "results/logs/amend_arm_wrongly.log",
    benchmark:
        "results/benchmarks/amend_arm_wrongly/all.jsonl"
    conda:
        "../envs/gap.yaml"
    resources:
        mem_mb=1500,
        runtime="20m",
    params:
        code=script_digest("amend_arm_wrongly"),
        seed=SEED,
    message:
        "Amend the arm by another effect that changes as much"
    script:
        "../scripts/amend_arm_wrongly.py"


rule amend_camera_wrongly:
    input:
        nominal=project_file("models/nominal.yaml"),
        views="results/picture_gap/postures",
        before=f"results/picture_gap/photos/{PICTURE_GAP.settings['reference']}",
        after="results/picture_gap/photos/{world}",
        findings="results/picture_gap/{world}/findings.json",
    output:
        model="results/picture_gap/{world}/wrong_name/model.yaml",
    log:
        "results/logs/amend_camera_wrongly/{world}.log",
    benchmark:
        "results/benchmarks/amend_camera_wrongly/{world}.jsonl"
    wildcard_constraints:
        world=one_of(PICTURE_GAP.settings["amended"]),
    conda:
        "../envs/gap.yaml"
    resources:
        mem_mb=2000,
        runtime="20m",
    params:
        code=script_digest("amend_camera_wrongly"),
        seed=SEED,
    message:
        "Amend the camera by another effect that changes as much in the photos of {wildcards.world}"
    script:
        "../scripts/amend_camera_wrongly.py"
