"""Write the page of one scene."""

from pathlib import Path
from typing import TYPE_CHECKING

from gsbridge.logs import start
from gsbridge.report.pages.scene import write_scene_page

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
write_scene_page(snakemake.wildcards.scene, Path(snakemake.params.folder), Path(snakemake.output.report))
