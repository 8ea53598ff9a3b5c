rule film_board:
    output:
        capture=directory("results/workspace/capture"),
        truth="results/truth/workspace/registration.json",
    log:
        "results/logs/film_board.log",
    benchmark:
        "results/benchmarks/film_board/all.jsonl"
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
        world=world_settings,
        seed=SEED,
    message:
        "Film the board with the mirror's wrist camera"
    script:
        "../scripts/film_board.py"


# Whoever tries policies in a world of some severity registers arm and table there, on that day, by its encoders and its camera.
use rule film_board as film_board_of_world with:
    output:
        capture=directory("results/workspace/worlds/{world}/capture"),
        truth="results/truth/workspace/worlds/{world}/registration.json",
    log:
        "results/logs/film_board/{world}.log",
    benchmark:
        "results/benchmarks/film_board/{world}.jsonl"
    wildcard_constraints:
        world=one_of(config["worlds"]),
    message:
        "Film the board with the wrist camera in {wildcards.world}"


rule register_workspace:
    input:
        capture=workspace_capture,
    output:
        registration=kept("results/workspace/registration.json"),
    log:
        "results/logs/register_workspace.log",
    benchmark:
        "results/benchmarks/register_workspace/all.jsonl"
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
        # The rule of the mirror's worlds inherits this; their captures are results.
        listing=lambda wildcards: [] if hasattr(wildcards, "world") else GIVEN.board,
        board=config["workspace"]["board"],
        scale=config["workspace"]["scale"],
        seed=SEED,
    message:
        "Register table and camera with the robot"
    script:
        "../scripts/register_workspace.py"


use rule register_workspace as register_world with:
    input:
        capture="results/workspace/worlds/{world}/capture",
    output:
        registration="results/workspace/worlds/{world}/registration.json",
    log:
        "results/logs/register_workspace/{world}.log",
    benchmark:
        "results/benchmarks/register_workspace/{world}.jsonl"
    wildcard_constraints:
        world=one_of(config["worlds"]),
    message:
        "Register table and camera with the robot in {wildcards.world}"
