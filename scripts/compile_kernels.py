"""Compile the kernels of training before jobs run side by side."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.scene import warmup as scene
from gsbridge.splats import warmup as splats

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
splats.compile_kernels()
scene.compile_kernels()
