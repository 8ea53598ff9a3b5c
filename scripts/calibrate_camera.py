"""Calibrate a camera that several captures share."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.photogrammetry.board import standard_board
from gsbridge.sfm.calibrate import calibrate_camera

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
calibrate_camera(
    keyframe_folders=[(Path(path).parent / "frames", Path(path)) for path in snakemake.input.keyframes],
    board=standard_board(snakemake.params.board),
    out_json=Path(snakemake.output.camera),
)
