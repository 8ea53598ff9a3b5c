rule copy_project_file:
    output:
        file=project_file("{file}"),
    log:
        "results/logs/copy_project_file/{file}.log",
    benchmark:
        "results/benchmarks/copy_project_file/{file}.jsonl"
    wildcard_constraints:
        file=one_of(PLAN.project_files),
    localrule: True
    conda:
        "../envs/report.yaml"
    params:
        digest=lambda wildcards: hashlib.sha256(
            (ROOT / wildcards.file).read_bytes()
        ).hexdigest(),
        # A function of outputs is not recorded: a project that was moved reruns nothing.
        original=lambda wildcards, output: ROOT / wildcards.file,
    message:
        "Copy {wildcards.file} of the project"
    shell:
        "cp {params.original:q} {output.file} 2> {log}"


rule select_keyframes:
    input:
        source=scene_source,
        # Where results lie in a bucket, a job gets what it names and nothing beside that.
        frames=film_frames,
    output:
        frames=kept(directory("results/scenes/{scene}/capture/frames")),
        keyframes=kept("results/scenes/{scene}/capture/keyframes.json"),
    log:
        "results/logs/select_keyframes/{scene}.log",
    benchmark:
        "results/benchmarks/select_keyframes/{scene}.jsonl"
    conda:
        "../envs/capture.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=script_digest("select_keyframes"),
        kind=lambda wildcards: PLAN.source(wildcards.scene)[0],
        listing=lambda wildcards: GIVEN.scene(wildcards.scene),
        settings=settings("capture"),
    message:
        "Select keyframes of {wildcards.scene}"
    script:
        "../scripts/select_keyframes.py"
