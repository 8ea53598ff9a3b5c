rule select_keyframes:
    input:
        source=scene_source,
    output:
        frames=directory("results/scenes/{scene}/capture/frames"),
        keyframes="results/scenes/{scene}/capture/keyframes.json",
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
        kind=source_kind,
        path=source_path,
        settings=settings("capture"),
    message:
        "Select keyframes of {wildcards.scene}"
    script:
        "../scripts/select_keyframes.py"
