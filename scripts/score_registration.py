"""Score the registration against the mirror's truth."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.registration import score_registration

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
score_registration(snakemake.input.registration, snakemake.input.truth, snakemake.output.scores)
