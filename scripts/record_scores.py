"""Record the figures of one area beside the code, with the rows behind them."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.evidence import record_area

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
record_area(snakemake.input.scores, snakemake.output.record, snakemake.params.kinds, snakemake.output.evidence)
