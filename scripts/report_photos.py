"""Write the report on what changed between photos."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.gap.picture_page import write_picture_report

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_picture_report(snakemake.wildcards.world, snakemake.input.findings, snakemake.input.pictures, snakemake.output.page)
