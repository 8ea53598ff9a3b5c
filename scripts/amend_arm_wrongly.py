"""Make a control: put an effect into the simulation's arm that was not named, but changes the motion as much."""

from typing import TYPE_CHECKING

from gsbridge.gap.loop.wrong_name import amend_arm_wrongly
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
given = snakemake.input
amend_arm_wrongly(given.nominal, given.arm, given.case, given.findings, snakemake.output.model, snakemake.params.seed)
