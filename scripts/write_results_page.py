"""Write the page of measured figures and their floors, areas recorded earlier included."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.results_page import write_results_page

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_results_page(Path(snakemake.input.scores[0]).parent, snakemake.output.page, snakemake.params.behind)
