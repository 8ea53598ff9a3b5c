"""Object masks: prompts from the sparse model, GrabCut made consistent over the views, or SAM 2."""

from gsbridge.masks.segment import segment_object
from gsbridge.masks.settings import MaskSettings

__all__ = ["MaskSettings", "segment_object"]
