"""Write a page about further worlds."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.tables.world_variants import write_world_variants

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_world_variants(snakemake.input.rows, snakemake.output.page)
