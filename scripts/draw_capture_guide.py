"""Photograph good and bad captures in the mirror, as one labelled sheet."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.reality.world.capture_guide import draw_capture_guide

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
draw_capture_guide(snakemake.output.figure, snakemake.threads)
