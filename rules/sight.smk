rule draw_postures:
    input:
        **simulated_world(SIGHT.cell["object"], SIGHT.cell["background"]),
        light="results/workspace/light.json",
    output:
        views=directory("results/sight/postures"),
        record="results/sight/postures.json",
    log:
        "results/logs/draw_postures.log",
    benchmark:
        "results/benchmarks/draw_postures/all.jsonl"
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="20m",
    params:
        code=script_digest("draw_postures"),
        postures=SIGHT.settings["postures"],
        size=settings("views")["size"],
        seed=SEED,
    message:
        "Choose the postures from which the wrist camera is photographed"
    script:
        "../scripts/draw_postures.py"


rule photograph_postures:
    input:
        views="results/sight/postures",
        record="results/sight/postures.json",
        item=f"results/scenes/{SIGHT.cell['object']}/asset/asset.json",
    output:
        photos=directory("results/sight/photos/{world}"),
        record="results/sight/photos/{world}.json",
    log:
        "results/logs/photograph_postures/{world}.log",
    benchmark:
        "results/benchmarks/photograph_postures/{world}.jsonl"
    wildcard_constraints:
        world=one_of(SIGHT.worlds),
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=2500,
        runtime="60m",
    params:
        code=script_digest("photograph_postures"),
        cell=SIGHT.cell,
        world=world_settings,
        shots=lambda wildcards: SIGHT.shots(wildcards.world),
        first=lambda wildcards: SIGHT.first_shot(wildcards.world),
        size=settings("views")["size"],
        samples=SIGHT.settings["samples"],
        sheet=settings("films")["sheet"],
        pieces="results/.state/pieces",
        seed=SEED,
    message:
        "Photograph the postures in {wildcards.world}"
    script:
        "../scripts/photograph_postures.py"


rule diagnose_photos:
    input:
        views="results/sight/postures",
        before=f"results/sight/photos/{SIGHT.settings['reference']}",
        after="results/sight/photos/{world}",
    output:
        findings="results/sight/{world}/findings.json",
        pictures="results/sight/{world}/pictures.npz",
    log:
        "results/logs/diagnose_photos/{world}.log",
    benchmark:
        "results/benchmarks/diagnose_photos/{world}.jsonl"
    wildcard_constraints:
        world=one_of(SIGHT.worlds),
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="30m",
    params:
        code=script_digest("diagnose_photos"),
        # Of the reference, the last photo of each posture stands for a later day.
        shot=lambda wildcards: SIGHT.shots(wildcards.world) - 1,
        seed=SEED,
    message:
        "Find what changed in the photos of {wildcards.world}"
    script:
        "../scripts/diagnose_photos.py"


rule report_photos:
    input:
        findings="results/sight/{world}/findings.json",
        pictures="results/sight/{world}/pictures.npz",
    output:
        page=report(
            "results/sight/{world}/report.html",
            caption="captions/sight.rst",
            category="Gap",
            labels={"result": "what the pictures lack", "of": "{world}"},
        ),
    log:
        "results/logs/report_photos/{world}.log",
    benchmark:
        "results/benchmarks/report_photos/{world}.jsonl"
    wildcard_constraints:
        world=one_of(SIGHT.worlds),
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("report_photos"),
    message:
        "Write the report on the photos of {wildcards.world}"
    script:
        "../scripts/report_photos.py"


rule amend_camera:
    input:
        nominal=project_file("models/nominal.yaml"),
        findings="results/sight/{world}/findings.json",
        # In photos of one day nothing may be found.
        reference=f"results/sight/{SIGHT.settings['reference']}/findings.json",
    output:
        model="results/sight/{world}/model.yaml",
    log:
        "results/logs/amend_camera/{world}.log",
    benchmark:
        "results/benchmarks/amend_camera/{world}.jsonl"
    wildcard_constraints:
        world=one_of(SIGHT.settings["amended"]),
    conda:
        "../envs/policy.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("amend_camera"),
    message:
        "Put what changed in {wildcards.world} into the simulation's camera"
    script:
        "../scripts/amend_camera.py"


rule collect_sight_loop:
    input:
        trials=SIGHT.tables,
        trainings=SIGHT.trainings,
        photos=collect("results/sight/photos/{world}.json", world=SIGHT.worlds),
        findings=collect("results/sight/{world}/findings.json", world=SIGHT.worlds),
        # The pages that tell how the findings came about.
        reports=collect("results/sight/{world}/report.html", world=SIGHT.worlds),
    output:
        rows="results/rows/sight_loop.csv",
        page="results/sight/loop.md",
        figure=report(
            "results/figures/sight_loop.png",
            caption="captions/sight_loop.rst",
            category="Gap",
            labels={
                "result": "closing the loop of pictures",
                "of": "policies with amended pictures",
            },
        ),
    log:
        "results/logs/collect_sight_loop.log",
    benchmark:
        "results/benchmarks/collect_sight_loop/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_sight_loop"),
        plan=SIGHT.rows,
        comparisons=SIGHT.comparisons,
        cell=SIGHT.cell,
        worlds=SIGHT.worlds,
    message:
        "Collect the successes before and after the camera was amended, and the price"
    script:
        "../scripts/collect_sight_loop.py"
