rule film_board:
    output:
        capture=directory("results/workspace/capture"),
        truth="results/truth/workspace/registration.json",
    log:
        "results/logs/film_board.log",
    benchmark:
        "results/benchmarks/film_board.jsonl"
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=2500,
        runtime="20m",
    params:
        code=script_digest("film_board"),
        settings=settings("board_film"),
        board=config["workspace"]["board"],
        background=config["workspace"]["background"] or "foam_pad",
        seed=SEED,
    message:
        "Film the board with the mirror's wrist camera"
    script:
        "../scripts/film_board.py"


rule register_workspace:
    input:
        capture=workspace_capture,
    output:
        registration="results/workspace/registration.json",
    log:
        "results/logs/register_workspace.log",
    benchmark:
        "results/benchmarks/register_workspace.jsonl"
    conda:
        "../envs/world.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime="10m",
    params:
        code=script_digest("register_workspace"),
        settings=settings("registration"),
        source=config["workspace"]["source"],
        board=config["workspace"]["board"],
        scale=config["workspace"]["scale"],
        seed=SEED,
    message:
        "Register table and camera with the robot"
    script:
        "../scripts/register_workspace.py"
