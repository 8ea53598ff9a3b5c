"""Film one scene of the mirror."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.configuration.films import FilmSettings
from gsbridge.logs import start
from gsbridge.reality.mirror.film import film_scene

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
film_scene(
    scene=snakemake.params.film,
    take=snakemake.params.take,
    settings=FilmSettings(**snakemake.params.settings),
    out_frames=Path(snakemake.output.frames),
    out_json=Path(snakemake.output.film),
    out_truth=Path(snakemake.output.truth),
    threads=snakemake.threads,
    seed=snakemake.params.seed,
    state=Path(snakemake.params.state),
)
