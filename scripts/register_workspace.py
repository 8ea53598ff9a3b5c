"""Find where the table stands before the robot and where the camera sits on its flange."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.configuration.registration import RegistrationSettings
from gsbridge.logs import start
from gsbridge.photogrammetry.board import standard_board
from gsbridge.registration.stage import register

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
register(
    source=snakemake.params.source,
    capture=Path(snakemake.input.capture) if snakemake.input.capture else None,
    out_json=Path(snakemake.output.registration),
    board=standard_board(snakemake.params.board),
    scale=snakemake.params.scale,
    settings=RegistrationSettings(**snakemake.params.settings),
    seed=snakemake.params.seed,
)
