"""Results that other machines write to object storage."""

from __future__ import annotations

import sys
from typing import Any

_PLUGIN = "snakemake_storage_plugin_s3"


def see_new_folders() -> None:
    """Let snakemake see folders in a bucket that a job on another machine has made.

    Snakemake's S3 plugin (0.3.6) asks only once, before the job, whether a name is a folder. It keeps the answer no, so that
    folders which the job makes count as missing, and the run ends. With this function it asks again after each no. Where the
    plugin is not in use, nothing happens.
    """
    plugin = sys.modules.get(_PLUGIN)
    kind: Any = getattr(plugin, "StorageObject", None)
    if kind is None or not hasattr(kind, "is_dir"):
        return
    kept = kind.is_dir

    def is_dir(item: Any) -> bool:
        if item._is_dir is False:
            item._is_dir = None
        return bool(kept(item))

    kind.is_dir = is_dir


__all__ = ["see_new_folders"]
