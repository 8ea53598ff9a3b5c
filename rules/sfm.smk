rule calibrate_camera:
    input:
        keyframes=calibration_keyframes,
    output:
        camera="results/cameras/{camera}.json",
    log:
        "results/logs/calibrate_camera/{camera}.log",
    benchmark:
        "results/benchmarks/calibrate_camera/{camera}.jsonl"
    conda:
        "../envs/capture.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=script_digest("calibrate_camera"),
        board=lambda wildcards: config["cameras"][wildcards.camera]["board"],
    message:
        "Calibrate the camera {wildcards.camera} from the board"
    script:
        "../scripts/calibrate_camera.py"


rule reconstruct_cameras:
    input:
        keyframes="results/scenes/{scene}/capture/keyframes.json",
        frames="results/scenes/{scene}/capture/frames",
        camera=scene_camera,
    output:
        model=kept(directory("results/scenes/{scene}/sfm/model")),
        images=kept(directory("results/scenes/{scene}/sfm/images")),
        tags=kept("results/scenes/{scene}/sfm/tags.json"),
        sfm=kept("results/scenes/{scene}/sfm/sfm.json"),
    log:
        "results/logs/reconstruct_cameras/{scene}.log",
    benchmark:
        "results/benchmarks/reconstruct_cameras/{scene}.jsonl"
    conda:
        "../envs/capture.yaml"
    threads: SCENE_THREADS
    resources:
        mem_mb=4000,
        runtime="60m",
    params:
        code=script_digest("reconstruct_cameras"),
        settings=settings("sfm"),
        workspace=lambda wildcards: f"results/.state/reconstruct_cameras/{wildcards.scene}",
        board=lambda wildcards: config["scenes"][wildcards.scene]["board"],
        seed=SEED,
    message:
        "Reconstruct the cameras of {wildcards.scene}"
    script:
        "../scripts/reconstruct_cameras.py"
