"""Make a control: put an effect into the simulation's camera that was not named, but changes the pictures as much."""

from typing import TYPE_CHECKING

from gsbridge.gap.loop.wrong_name import amend_camera_wrongly
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
given = snakemake.input
amend_camera_wrongly(
    given.nominal, (given.views, given.before, given.after), given.findings, snakemake.output.model, snakemake.params.seed
)
