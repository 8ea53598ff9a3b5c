"""Score the choice of keyframes on the film whose motion and blur are known."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.scores.keyframes import write_keyframe_score

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_keyframe_score(
    snakemake.output.scores,
    keyframes_json=snakemake.input.keyframes,
    truth_json=Path(snakemake.input.truth) / "truth.json",
)
