"""Write the simulated arm's URDF and model for the diagnosis of the gap."""

from typing import TYPE_CHECKING

from gsbridge.gap.loop.stages import describe_arm
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
describe_arm(
    snakemake.input.robot,
    snakemake.input.registration,
    snakemake.input.model,
    snakemake.output.urdf,
    snakemake.output.model,
)
