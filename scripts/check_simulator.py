"""Compare the simulated arm with that of another engine, and an episode with its repetition."""

from typing import TYPE_CHECKING

from gsbridge.environment.build import StageFiles
from gsbridge.environment.checks import check_simulator
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
check_simulator(
    StageFiles.of(dict(snakemake.input.items())),
    snakemake.output.record,
)
