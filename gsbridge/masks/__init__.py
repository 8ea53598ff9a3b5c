"""Object masks: prompts from the sparse model, GrabCut made consistent over the views, or SAM 2."""

from gsbridge.configuration.masks import MaskSettings
from gsbridge.masks.segment import segment_object

__all__ = ["MaskSettings", "segment_object"]
