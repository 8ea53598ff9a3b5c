rule build_asset:
    input:
        align="results/scenes/{scene}/align/align.json",
        visual="results/scenes/{scene}/mesh/visual.ply",
        collision="results/scenes/{scene}/mesh/collision.ply",
        splats=f"results/scenes/{{scene}}/splats/{settings('asset')['binding']}/splats.ply",
        splats_record=f"results/scenes/{{scene}}/splats/{settings('asset')['binding']}/splats.json",
        mask_images=scene_mask_images,
        views="results/scenes/{scene}/align/views.json",
        images="results/scenes/{scene}/sfm/images",
    output:
        urdf=kept("results/scenes/{scene}/asset/body.urdf"),
        hulls=kept(directory("results/scenes/{scene}/asset/hulls")),
        visual=kept("results/scenes/{scene}/asset/visual.ply"),
        splats=kept("results/scenes/{scene}/asset/splats.ply"),
        record=kept("results/scenes/{scene}/asset/asset.json"),
    log:
        "results/logs/build_asset/{scene}.log",
    benchmark:
        "results/benchmarks/build_asset/{scene}.jsonl"
    conda:
        "../envs/assets.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime="10m",
    params:
        code=script_digest("build_asset"),
        settings=asset_settings,
        margin_px=lambda wildcards: splat_settings(wildcards)["margin_px"],
        kind=lambda wildcards: config["scenes"][wildcards.scene]["kind"],
        seed=SEED,
    message:
        "Bundle {wildcards.scene} for simulators"
    script:
        "../scripts/build_asset.py"
