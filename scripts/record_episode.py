"""Record one episode for rerun."""

from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.recordings.episode import EpisodeFiles, record_episode

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
record_episode(
    EpisodeFiles(
        episode=snakemake.input.episode,
        robot=snakemake.input.robot,
        item=snakemake.input.item,
        background=snakemake.input.background,
        photos=snakemake.input.get("photos") or None,
    ),
    f"{snakemake.wildcards.object}+{snakemake.wildcards.background}",
    snakemake.output.recording,
)
