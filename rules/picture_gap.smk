rule draw_postures:
    input:
        **simulated_world(PICTURE_GAP.cell["object"], PICTURE_GAP.cell["background"]),
        light="results/workspace/light.json",
    output:
        views=directory("results/picture_gap/postures"),
        record="results/picture_gap/postures.json",
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
        postures=PICTURE_GAP.settings["postures"],
        size=settings("views")["size"],
        seed=SEED,
    message:
        "Choose the postures from which the wrist camera is photographed"
    script:
        "../scripts/draw_postures.py"


rule photograph_postures:
    input:
        views="results/picture_gap/postures",
        record="results/picture_gap/postures.json",
        item=f"results/scenes/{PICTURE_GAP.cell['object']}/asset/asset.json",
    output:
        photos=directory("results/picture_gap/photos/{world}"),
        record="results/picture_gap/photos/{world}.json",
    log:
        "results/logs/photograph_postures/{world}.log",
    benchmark:
        "results/benchmarks/photograph_postures/{world}.jsonl"
    wildcard_constraints:
        world=one_of(PICTURE_GAP.worlds),
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=2500,
        runtime="60m",
    params:
        code=script_digest("photograph_postures"),
        cell=PICTURE_GAP.cell,
        world=world_settings,
        shots=lambda wildcards: PICTURE_GAP.shots(wildcards.world),
        first=lambda wildcards: PICTURE_GAP.first_shot(wildcards.world),
        size=settings("views")["size"],
        samples=PICTURE_GAP.settings["samples"],
        sheet=settings("films")["sheet"],
        pieces="results/.state/pieces",
        seed=SEED,
    message:
        "Photograph the postures in {wildcards.world}"
    script:
        "../scripts/photograph_postures.py"


rule diagnose_photos:
    input:
        views="results/picture_gap/postures",
        before=f"results/picture_gap/photos/{PICTURE_GAP.settings['reference']}",
        after="results/picture_gap/photos/{world}",
    output:
        findings="results/picture_gap/{world}/findings.json",
        pictures="results/picture_gap/{world}/pictures.npz",
    log:
        "results/logs/diagnose_photos/{world}.log",
    benchmark:
        "results/benchmarks/diagnose_photos/{world}.jsonl"
    wildcard_constraints:
        world=one_of(PICTURE_GAP.worlds),
    conda:
        "../envs/gap.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="30m",
    params:
        code=script_digest("diagnose_photos"),
        # Of the reference, the last photo of each posture stands for a later day.
        shot=lambda wildcards: PICTURE_GAP.shots(wildcards.world) - 1,
        seed=SEED,
    message:
        "Find what changed in the photos of {wildcards.world}"
    script:
        "../scripts/diagnose_photos.py"


rule report_photos:
    input:
        findings="results/picture_gap/{world}/findings.json",
        pictures="results/picture_gap/{world}/pictures.npz",
    output:
        page=report(
            "results/picture_gap/{world}/report.html",
            caption="captions/picture_gap.rst",
            category="Gap",
            labels={"result": "what the pictures lack", "of": "{world}"},
        ),
    log:
        "results/logs/report_photos/{world}.log",
    benchmark:
        "results/benchmarks/report_photos/{world}.jsonl"
    wildcard_constraints:
        world=one_of(PICTURE_GAP.worlds),
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
        findings="results/picture_gap/{world}/findings.json",
        # In photos of one day nothing may be found.
        reference=f"results/picture_gap/{PICTURE_GAP.settings['reference']}/findings.json",
    output:
        model="results/picture_gap/{world}/model.yaml",
    log:
        "results/logs/amend_camera/{world}.log",
    benchmark:
        "results/benchmarks/amend_camera/{world}.jsonl"
    wildcard_constraints:
        world=one_of(PICTURE_GAP.settings["amended"]),
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


rule collect_picture_loop:
    input:
        trials=PICTURE_GAP.tables,
        trainings=PICTURE_GAP.trainings,
        photos=collect(
            "results/picture_gap/photos/{world}.json", world=PICTURE_GAP.worlds
        ),
        findings=collect(
            "results/picture_gap/{world}/findings.json", world=PICTURE_GAP.worlds
        ),
        # The pages that tell how the findings came about.
        reports=collect(
            "results/picture_gap/{world}/report.html", world=PICTURE_GAP.worlds
        ),
    output:
        rows="results/rows/picture_loop.csv",
        page="results/picture_gap/loop.md",
        figure=report(
            "results/figures/picture_loop.png",
            caption="captions/picture_loop.rst",
            category="Gap",
            labels={
                "result": "closing the loop of pictures",
                "of": "policies with amended pictures",
            },
        ),
    log:
        "results/logs/collect_picture_loop.log",
    benchmark:
        "results/benchmarks/collect_picture_loop/all.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("collect_picture_loop"),
        plan=PICTURE_GAP.rows,
        comparisons=PICTURE_GAP.comparisons,
        cell=PICTURE_GAP.cell,
        worlds=PICTURE_GAP.worlds,
    message:
        "Collect the successes before and after the camera was amended, and the price"
    script:
        "../scripts/collect_picture_loop.py"
