"""Reconstruct a capture from its keyframes in quarter turns, up to the mesh: it should come out the same."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.turned import StageSettings, write_turned_reconstruction

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_turned_reconstruction(
    snakemake.output.record,
    usual={name: Path(path) for name, path in snakemake.input.items()},
    frames=Path(snakemake.input.frames),
    keyframes=Path(snakemake.input.keyframes),
    degrees=int(snakemake.wildcards.degrees),
    settings=StageSettings.of(dict(snakemake.params)),
    work=Path(snakemake.params.workspace),
    seed=snakemake.params.seed,
    threads=snakemake.threads,
)
