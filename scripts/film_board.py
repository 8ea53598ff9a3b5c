"""Photograph the board with the wrist camera of the mirror's arm."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.configuration.films import BoardFilmSettings
from gsbridge.logs import start
from gsbridge.photogrammetry.board import standard_board
from gsbridge.reality.world.board_capture import film_board
from gsbridge.reality.world.world_variants import configured_world

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
film_board(
    out_capture=Path(snakemake.output.capture),
    out_truth=Path(snakemake.output.truth),
    board=standard_board(snakemake.params.board),
    settings=BoardFilmSettings(**snakemake.params.settings),
    threads=snakemake.threads,
    seed=snakemake.params.seed,
    hidden=configured_world(snakemake.params.seed, snakemake.params.world, snakemake.wildcards.get("world", "mirror")),
    background=snakemake.params.background,
)
