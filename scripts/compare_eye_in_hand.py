"""Compare the renderers with the mirror's wrist camera."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.figures.eye_in_hand import Looked, write_eye_in_hand

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_eye_in_hand(
    [
        Looked(*pair.split("+"), Path(drawn), Path(photos))
        for pair, drawn, photos in zip(snakemake.params.pairs, snakemake.input.drawn, snakemake.input.photos, strict=True)
    ],
    snakemake.output.figure,
    snakemake.output.rows,
)
