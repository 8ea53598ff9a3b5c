"""Learning curves for TensorBoard."""

from __future__ import annotations

from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.files import atomic_directory
from gsbridge.report.recordings.training import GROUPS, read_curve


def write_events(curve: str | Path, out: str | Path) -> None:
    """Write a learning curve as TensorBoard's event file: every figure over environment steps.

    Args:
        curve: `training.csv`.
        out: Folder for `tensorboard --logdir`.

    Raises:
        InputError: TensorBoard is not installed, or the curve cannot be read.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise InputError("tensorboard", "it is not installed", 'Run: pip install "gsbridge[tensorboard]"') from error
    rows = read_curve(curve)
    with atomic_directory(out) as temporary, SummaryWriter(str(temporary)) as writer:
        for row in rows:
            for group, columns in GROUPS.items():
                for column in columns:
                    value = row[column]
                    if value is not None:
                        writer.add_scalar(f"{group}/{column}", value, int(row["step"] or 0))
