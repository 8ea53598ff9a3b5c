"""Write a case of the gap about the arm."""

from typing import TYPE_CHECKING

from gsbridge.gap.loop.stages import write_loop_case
from gsbridge.logs import start
from gsbridge.policy.joint_log import ROLES

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_loop_case(
    snakemake.input.model,
    {role: snakemake.input[role] for role in ROLES},
    snakemake.output.case,
    snakemake.input.calibration or None,
)
