"""Logs of any known format as records: CSV and Parquet, LeRobot data sets, MCAP.

Every format becomes a table with our columns, and that is read and checked by one and the same code.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.gap.formats.lerobot import read_lerobot
from gsbridge.gap.formats.mcap import read_mcap
from gsbridge.gap.formats.records import Layout, Record, read_record, record_of


def split_part(path: str | Path) -> tuple[Path, str]:
    """A log's file and which part of it is meant: `data#3` is episode 3, `log.mcap#/joint_states` a topic."""
    name, mark, part = str(path).partition("#")
    return Path(name), part if mark else ""


def read_log(path: str | Path, layout: Layout) -> Record:
    """Read a record from a log of any known format.

    Args:
        path: CSV or Parquet; the folder of a LeRobot data set with `#EPISODE`; an MCAP file with `#TOPIC` or `#TOPIC,COMMANDS`.
        layout: How its columns are called.

    Raises:
        InputError: As `read_record`; the part is missing or ambiguous, or an optional package is not installed.
    """
    file, part = split_part(path)
    if file.suffix == ".mcap":
        table, digest = read_mcap(file, part, layout.joints, layout.sliding)
    elif file.is_dir():
        table, digest = read_lerobot(file, part, layout.joints)
    elif part:
        raise InputError(path, "only data sets and MCAP files have parts", "Leave out what stands behind '#'")
    else:
        return read_record(file, layout)
    record = record_of(table, Path(path), layout, digest=digest)
    return replace(record, name=f"{file.stem}#{part}" if part else file.stem)
