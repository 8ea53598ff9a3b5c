rule describe_robot:
    input:
        registration="results/workspace/registration.json",
    output:
        robot=directory("results/robot/description"),
    log:
        "results/logs/describe_robot.log",
    benchmark:
        "results/benchmarks/describe_robot/all.jsonl"
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="5m",
    params:
        code=script_digest("describe_robot"),
    message:
        "Describe the robot with its registered camera"
    script:
        "../scripts/describe_robot.py"


rule calibrate_wrist_camera:
    input:
        registration="results/workspace/registration.json",
        robot="results/robot/description",
        capture=workspace_capture,
        background=workspace_background,
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        record="results/workspace/photometry.json",
    log:
        "results/logs/calibrate_wrist_camera.log",
    benchmark:
        "results/benchmarks/calibrate_wrist_camera/all.jsonl"
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime="10m",
    params:
        code=script_digest("calibrate_wrist_camera"),
    message:
        "Measure how the wrist camera sees colours"
    script:
        "../scripts/calibrate_wrist_camera.py"


rule calibrate_light:
    input:
        **PLAN.workspace_light,
        robot="results/robot/description",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        record="results/workspace/light.json",
    log:
        "results/logs/calibrate_light.log",
    benchmark:
        "results/benchmarks/calibrate_light/all.jsonl"
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=script_digest("calibrate_light"),
    message:
        "Find the light over the table from an object's shadow"
    script:
        "../scripts/calibrate_light.py"


rule fit_robot_splats:
    input:
        robot="results/robot/description",
        photometry="results/workspace/photometry.json",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        splats=directory("results/robot/splats"),
    log:
        "results/logs/fit_robot_splats.log",
    benchmark:
        "results/benchmarks/fit_robot_splats/all.jsonl"
    conda:
        "../envs/assets.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="20m",
    params:
        code=script_digest("fit_robot_splats"),
        seed=SEED,
    message:
        "Fit splats to the links of the robot"
    script:
        "../scripts/fit_robot_splats.py"


rule draw_views:
    input:
        robot="results/robot/description",
        robot_splats="results/robot/splats",
        registration="results/workspace/registration.json",
        photometry="results/workspace/photometry.json",
        light="results/workspace/light.json",
        item="results/scenes/{object}/asset/asset.json",
        background="results/scenes/{background}/asset/asset.json",
        model=project_file("models/nominal.yaml"),
        views="results/scenes/{object}/align/views.json",
        images="results/scenes/{object}/sfm/images",
        masks="results/scenes/{object}/masks/images",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        pictures=directory("results/views/{object}+{background}/drawn"),
        record="results/views/{object}+{background}/drawn.json",
    log:
        "results/logs/draw_views/{object}+{background}.log",
    benchmark:
        "results/benchmarks/draw_views/{object}+{background}.jsonl"
    wildcard_constraints:
        object=one_of(OBJECTS),
        background=one_of(BACKGROUNDS),
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="20m",
    params:
        code=script_digest("draw_views"),
        settings=settings("views"),
    message:
        "Draw what the wrist camera sees of {wildcards.object} on {wildcards.background}"
    script:
        "../scripts/draw_views.py"


rule photograph_views:
    input:
        pictures="results/views/{object}+{background}/drawn",
        record="results/views/{object}+{background}/drawn.json",
        item="results/scenes/{object}/asset/asset.json",
    output:
        photos=directory("results/views/{object}+{background}/mirror"),
        record="results/views/{object}+{background}/mirror.json",
    log:
        "results/logs/photograph_views/{object}+{background}.log",
    benchmark:
        "results/benchmarks/photograph_views/{object}+{background}.jsonl"
    wildcard_constraints:
        object=one_of(IN_MIRROR.intersection(OBJECTS)),
        background=one_of(IN_MIRROR.intersection(BACKGROUNDS)),
    conda:
        "../envs/world.yaml"
    threads: MANY_THREADS
    resources:
        mem_mb=2500,
        runtime="60m",
    params:
        code=script_digest("photograph_views"),
        settings=settings("views"),
        sheet=settings("films")["sheet"],
        pieces="results/.state/pieces",
        seed=SEED,
    message:
        "Photograph {wildcards.object} on {wildcards.background} in the mirror"
    script:
        "../scripts/photograph_views.py"


rule compare_eye_in_hand:
    input:
        drawn=collect("results/views/{pair}/drawn", pair=PLAN.both_filmed(PLAN.pairs)),
        photos=collect("results/views/{pair}/mirror", pair=PLAN.both_filmed(PLAN.pairs)),
    output:
        figure=report(
            "results/figures/eye_in_hand.png",
            caption="captions/eye_in_hand.rst",
            category="Simulator",
            labels={
                "result": "what the wrist camera sees",
                "of": "mirror and simulation",
            },
        ),
        rows="results/rows/eye_in_hand.csv",
    log:
        "results/logs/compare_eye_in_hand.log",
    benchmark:
        "results/benchmarks/compare_eye_in_hand/all.jsonl"
    conda:
        "../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=script_digest("compare_eye_in_hand"),
        pairs=PLAN.both_filmed(PLAN.pairs),
    message:
        "Compare renderers with the mirror's wrist camera"
    script:
        "../scripts/compare_eye_in_hand.py"
