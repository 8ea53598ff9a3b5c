"""Deform an object's mesh and show how its splats follow."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.configuration.measuring import EditingSettings
from gsbridge.logs import start
from gsbridge.report.figures.editing import write_editing

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_editing(
    Path("results/scenes") / snakemake.params.scene,
    snakemake.output.figure,
    snakemake.output.record,
    EditingSettings(**snakemake.params.settings),
)
