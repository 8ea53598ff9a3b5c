"""Select the keyframes of one capture."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.capture.keyframes import select_keyframes
from gsbridge.capture.sources import Source
from gsbridge.configuration.capture import KeyframeSettings
from gsbridge.logs import start

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
capture = Path(snakemake.input.source)
select_keyframes(
    source=Source(snakemake.params.kind, capture.parent if snakemake.params.kind == "film" else capture),
    out_frames=Path(snakemake.output.frames),
    out_json=Path(snakemake.output.keyframes),
    settings=KeyframeSettings(**snakemake.params.settings),
)
