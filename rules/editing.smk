rule show_editing:
    input:
        soft=f"results/scenes/{EDITED}/splats/soft/splats.json",
        games=f"results/scenes/{EDITED}/splats/games/splats.json",
        refined=f"results/scenes/{EDITED}/splats/refined/splats.json",
        views=f"results/scenes/{EDITED}/align/views.json",
        images=f"results/scenes/{EDITED}/sfm/images",
        kernels=ancient("results/.state/compile_kernels.done"),
    output:
        figure=report(
            "results/figures/gs_editing.png",
            caption="captions/gs_editing.rst",
            category="Scenes",
            labels={"result": "non-rigid edits", "of": EDITED},
        ),
        record="results/figures/gs_editing.json",
    log:
        "results/logs/show_editing.log",
    benchmark:
        "results/benchmarks/show_editing/all.jsonl"
    conda:
        "../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="20m",
    params:
        code=script_digest("show_editing"),
        scene=EDITED,
        settings=settings("editing"),
    message:
        "Deform the object and show how its splats follow"
    script:
        "../scripts/show_editing.py"
