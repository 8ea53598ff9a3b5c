"""Compile the kernels of training, before jobs run side by side."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.splats.warmup import compile_kernels

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
compile_kernels()
