rule record_capture:
    input:
        keyframes="results/scenes/{scene}/capture/keyframes.json",
        frames="results/scenes/{scene}/capture/frames",
    output:
        recording="results/rerun/capture/{scene}.rrd",
    log:
        "results/logs/record_capture/{scene}.log",
    benchmark:
        "results/benchmarks/record_capture/{scene}.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        runtime="10m",
        mem_mb=2000,
    params:
        code=script_digest("record_capture"),
    message:
        "Record the keyframes of {wildcards.scene}"
    script:
        "../scripts/record_capture.py"


rule record_sfm:
    input:
        model="results/scenes/{scene}/sfm/model",
        images="results/scenes/{scene}/sfm/images",
        sfm="results/scenes/{scene}/sfm/sfm.json",
    output:
        recording="results/rerun/sfm/{scene}.rrd",
    log:
        "results/logs/record_sfm/{scene}.log",
    benchmark:
        "results/benchmarks/record_sfm/{scene}.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        runtime="10m",
        mem_mb=2000,
    params:
        code=script_digest("record_sfm"),
    message:
        "Record the cameras of {wildcards.scene}"
    script:
        "../scripts/record_sfm.py"


rule record_align:
    input:
        align="results/scenes/{scene}/align/align.json",
        views="results/scenes/{scene}/align/views.json",
        images="results/scenes/{scene}/sfm/images",
        points="results/scenes/{scene}/align/points.npz",
        tags="results/scenes/{scene}/sfm/tags.json",
    output:
        recording="results/rerun/align/{scene}.rrd",
    log:
        "results/logs/record_align/{scene}.log",
    benchmark:
        "results/benchmarks/record_align/{scene}.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        runtime="10m",
        mem_mb=2000,
    params:
        code=script_digest("record_align"),
        board=lambda wildcards: config["scenes"][wildcards.scene]["board"],
    message:
        "Record the alignment of {wildcards.scene}"
    script:
        "../scripts/record_align.py"


rule record_masks:
    input:
        views="results/scenes/{scene}/align/views.json",
        images="results/scenes/{scene}/sfm/images",
        record="results/scenes/{scene}/masks/masks.json",
        masks="results/scenes/{scene}/masks/images",
    output:
        recording="results/rerun/masks/{scene}.rrd",
    log:
        "results/logs/record_masks/{scene}.log",
    benchmark:
        "results/benchmarks/record_masks/{scene}.jsonl"
    wildcard_constraints:
        scene=one_of(OBJECTS),
    conda:
        "../envs/report.yaml"
    resources:
        runtime="10m",
        mem_mb=2000,
    params:
        code=script_digest("record_masks"),
    message:
        "Record the masks of {wildcards.scene}"
    script:
        "../scripts/record_masks.py"


rule record_mesh:
    input:
        record="results/scenes/{scene}/mesh/mesh.json",
        visual="results/scenes/{scene}/mesh/visual.ply",
        collision="results/scenes/{scene}/mesh/collision.ply",
    output:
        recording="results/rerun/mesh/{scene}.rrd",
    log:
        "results/logs/record_mesh/{scene}.log",
    benchmark:
        "results/benchmarks/record_mesh/{scene}.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        runtime="10m",
        mem_mb=2000,
    params:
        code=script_digest("record_mesh"),
    message:
        "Record the meshes of {wildcards.scene}"
    script:
        "../scripts/record_mesh.py"


rule record_splats:
    input:
        record="results/scenes/{scene}/splats/{binding}/splats.json",
        splats="results/scenes/{scene}/splats/{binding}/splats.ply",
        views="results/scenes/{scene}/splats/{binding}/views",
    output:
        recording="results/rerun/splats/{scene}-{binding}.rrd",
    log:
        "results/logs/record_splats/{scene}-{binding}.log",
    benchmark:
        "results/benchmarks/record_splats/{scene}-{binding}.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        runtime="10m",
        mem_mb=2000,
    params:
        code=script_digest("record_splats"),
    message:
        "Record the {wildcards.binding} splats of {wildcards.scene}"
    script:
        "../scripts/record_splats.py"


rule recordings:
    input:
        PLAN.stage_recordings,
        TABLES.recordings,
    localrule: True


rule record_asset:
    input:
        record="results/scenes/{scene}/asset/asset.json",
        visual="results/scenes/{scene}/asset/visual.ply",
        splats="results/scenes/{scene}/asset/splats.ply",
        hulls="results/scenes/{scene}/asset/hulls",
    output:
        recording="results/rerun/asset/{scene}.rrd",
    log:
        "results/logs/record_asset/{scene}.log",
    benchmark:
        "results/benchmarks/record_asset/{scene}.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        runtime="10m",
        mem_mb=2000,
    params:
        code=script_digest("record_asset"),
    message:
        "Record the asset of {wildcards.scene}"
    script:
        "../scripts/record_asset.py"


rule record_training:
    input:
        curve=ANY.file("{seed}", "training.csv"),
        record=ANY.file("{seed}", "training.json"),
    output:
        recording=f"results/rerun/training/{POLICY_ITEM}.rrd",
    log:
        f"results/logs/record_training/{POLICY_ITEM}.log",
    benchmark:
        f"results/benchmarks/record_training/{POLICY_ITEM}.jsonl"
    conda:
        "../envs/report.yaml"
    resources:
        runtime="10m",
        mem_mb=1000,
    params:
        code=script_digest("record_training"),
        name=lambda wildcards: "-".join(wildcards),
    message:
        "Record the training of {wildcards.variant} to {wildcards.task} {wildcards.object} on {wildcards.background}, {wildcards.renderer}"
    script:
        "../scripts/record_training.py"


# On demand: it needs the extra `tensorboard`.
rule export_tensorboard:
    input:
        curve=ANY.file("{seed}", "training.csv"),
    output:
        events=directory(f"results/tensorboard/{POLICY_ITEM}"),
    log:
        f"results/logs/export_tensorboard/{POLICY_ITEM}.log",
    benchmark:
        f"results/benchmarks/export_tensorboard/{POLICY_ITEM}.jsonl"
    conda:
        "../envs/policy.yaml"
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("export_tensorboard"),
    message:
        "Write the training of {wildcards.variant} for TensorBoard: {wildcards.task} {wildcards.object} on {wildcards.background}, {wildcards.renderer}"
    script:
        "../scripts/export_tensorboard.py"
