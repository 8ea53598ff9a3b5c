"""Reconstruct the cameras of one capture and undistort its photos."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.configuration.sfm import SfmSettings
from gsbridge.logs import start
from gsbridge.photogrammetry.board import optional_board
from gsbridge.sfm.calibrate import optional_camera
from gsbridge.sfm.stage import reconstruct

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
reconstruct(
    frames=Path(snakemake.input.frames),
    keyframes_json=Path(snakemake.input.keyframes),
    out_model=Path(snakemake.output.model),
    out_images=Path(snakemake.output.images),
    out_json=Path(snakemake.output.sfm),
    out_tags=Path(snakemake.output.tags),
    settings=SfmSettings(**snakemake.params.settings),
    camera=optional_camera(snakemake.input.get("camera")),
    board=optional_board(snakemake.params.board),
    workspace=Path(snakemake.params.workspace),
    seed=snakemake.params.seed,
    threads=snakemake.threads,
)
