"""The table frame: which plane is the table, which way is up, how long is a metre."""

from gsbridge.align.stage import AlignSettings, align_scene

__all__ = ["AlignSettings", "align_scene"]
