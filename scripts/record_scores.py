"""Record the figures of one area beside the code, with the rows behind them."""

import shutil
from typing import TYPE_CHECKING

from gsbridge.files import atomic_file
from gsbridge.logs import start
from gsbridge.report.scores.evidence import write_evidence

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_evidence(snakemake.params.kinds, snakemake.output.evidence)
with atomic_file(snakemake.output.record) as record:
    shutil.copyfile(snakemake.input.scores, record)
