"""Measure how the wrist camera sees colours, and the colours of the hand."""

from typing import TYPE_CHECKING

from gsbridge.environment.photometry import calibrate_wrist_camera
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
calibrate_wrist_camera(
    snakemake.output.record,
    registration=snakemake.input.registration,
    robot=snakemake.input.robot,
    capture=snakemake.input.capture or None,
    background=snakemake.input.background or None,
)
