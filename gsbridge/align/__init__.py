"""The table frame: which plane is the table, which way is up, how long is a metre."""

from gsbridge.align.stage import align_scene
from gsbridge.configuration.align import AlignSettings

__all__ = ["AlignSettings", "align_scene"]
