"""Compare policies at different severities: what splats are worth, or how well simulation foretells graded ones."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.worth import write_graded_figure, write_worth_figure
from gsbridge.report.tables.worth import write_graded_page, write_severity_rows, write_worth_page

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
rows = snakemake.output.rows
write_severity_rows(rows, snakemake.input.trials, snakemake.params.severities, policies=snakemake.input.policies)
if snakemake.wildcards.who == "worth":
    write_worth_page(rows, snakemake.output.page)
    write_worth_figure(rows, snakemake.output.figure)
else:
    write_graded_page(rows, snakemake.output.page)
    write_graded_figure(rows, snakemake.output.figure)
