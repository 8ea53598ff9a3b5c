"""Earlier results that snakemake keeps while a job makes them anew, by hard links in place of copies."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import Any

_MODULE, _CLASS = "snakemake.persistence", "PersistenceBase"


def link_backups() -> None:
    """Let snakemake keep earlier outputs of a job (those marked by `update`) by hard links, with the records of how they came.

    Snakemake (9.27) copies them. That takes room, so that a full disk ends in a traceback before the job could tell it, and
    it stops at a copy that a killed job has left. Stages replace their outputs whole and never write into them, so that a link
    keeps the earlier version. Where a link cannot be made, the earlier version is copied; where there is no room for that,
    nothing is kept, and only a job that fails loses what it was to replace.

    Snakemake also records outputs that it has put back as if the failed job had made them, so that the same command finds
    nothing to do and tells no error any more. With this function their earlier records stay, and the job is tried again.
    """
    kind: Any = getattr(sys.modules.get(_MODULE), _CLASS, None)
    if kind is None or not all(hasattr(kind, name) for name in ("_get_backup_path", "_unmark_incomplete", "finished")):
        return
    finished = kind.finished
    restored: set[str] = set()

    def backup_output(self: Any, path: Path) -> None:
        keep(path, self._get_backup_path(path))

    def restore_output(self: Any, path: Path) -> bool:
        done = put_back(path, self._get_backup_path(path))
        if done:
            restored.add(str(path))
        return done

    async def record(self: Any, job: Any) -> None:
        outputs = {str(Path(output)): output for output in job.output}
        if not restored.intersection(outputs):
            await finished(self, job)
            return
        restored.difference_update(outputs)
        self._clear_cache()
        for output in outputs.values():
            self._unmark_incomplete(self._get_key(output))

    kind.backup_output, kind.restore_output, kind.finished = backup_output, restore_output, record


def keep(path: Path, backup: Path) -> None:
    """Keep the present version of a result, a file or a folder, in the place of any that was kept before.

    Args:
        path: The result.
        backup: Where it is kept.
    """
    _remove(backup)
    try:
        backup.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            shutil.copytree(path, backup, copy_function=_link)
        else:
            _link(path, backup)
    except OSError:
        # `shutil.Error`, which a folder ends in, is an OSError, too.
        _remove(backup)


def put_back(path: Path, backup: Path) -> bool:
    """Put a kept version of a result back in its place.

    Args:
        path: The result.
        backup: Where it is kept.

    Returns:
        Whether a version was kept.
    """
    if not backup.exists():
        return False
    _remove(path)
    shutil.move(backup, path)
    return True


def _link(source: str | Path, target: str | Path) -> None:
    """Give a file a second name; copy it, with its date, on a disk that has no hard links."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def _remove(path: Path) -> None:
    """Remove a file or a folder, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


__all__ = ["keep", "link_backups", "put_back"]
